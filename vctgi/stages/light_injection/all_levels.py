"""The same sums as `injection.py` makes, of all levels in one launch a light.

That is for what most frames ask for: each texel adds its power to the voxel that it lies in, and
nothing has derivatives. Nothing waits for the host. What is not covered by surfaces is neither
cleared nor read, as nearly all slots of a clipmap are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import gather_own, texel_from_voxel
from vctgi.clipmap.slots import filled_layers, surface_slot
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.number_rows import IntegerRow, entry
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import FallenLight, LightTexels
from vctgi.stages.light_injection.config import LightInjectionConfig
from vctgi.stages.light_injection.splats import fixed_point, radiance_per_flux

CHANNELS = 3
"""Sums of a slot."""

SUM_BITS = 60
"""The sum of everything that is injected is below 2 to this power."""

MANTISSA_BITS, EXPONENT_BIAS = 52, 1023
"""Of numbers in double precision."""

NEVER_INSIDE = -(2**30)
"""Origin of a window that holds no voxel."""


def is_by_scatter(config: LightInjectionConfig) -> bool:
    """Whether a configuration asks for no more than is done here."""
    return (config.algorithm, config.prefilter, config.normalisation) == ("scatter", 1, "power")


@dataclass
class SlotSums:
    """Light in the slots of all clip levels; the attributes are those of `SummedLight`.

    Attributes
    ----------
    alphas
        Opacity of each clip level.
    """

    alphas: list[mi.Float]
    sums: mi.Int64
    per_step: mi.Float64

    def read(self, level: int, index: mi.UInt32, active: mi.Bool) -> mi.Color3f:
        """Return emittance of slots of a clip level, W m^-2 sr^-1."""
        alpha = dr.gather(mi.Float, self.alphas[level], index, active)
        slot = mi.UInt32(level * dr.width(self.alphas[level])) + index
        is_lit = active & (alpha > 0.0)
        per_step = entry(self.per_step, level)
        sums = (
            dr.gather(mi.Int64, self.sums, CHANNELS * slot + channel, is_lit)
            for channel in range(CHANNELS)
        )
        return mi.Color3f(*(mi.Float(mi.Float64(each) * per_step) for each in sums))


@dataclass
class SummedLight:
    """Light in the slots of all clip levels, in fixed point.

    Attributes
    ----------
    opacity
        The voxels that were lit.
    sums
        [level, direction, z, y, x, channel]; of slots without opacity, any number.
    per_step
        [level] W m^-2 sr^-1 of a step.
    total
        Sum of the largest channels of all flux, W; not finite where a light's power or what a
        surface reflects is none.
    fallen
        What became of it.
    """

    opacity: OpacityClipmap
    sums: mi.Int64
    per_step: mi.Float64
    total: mi.Float64
    fallen: FallenLight

    @property
    def slots(self) -> SlotSums:
        """Arrays of the same, and nothing else."""
        alphas = self.opacity.levels[: self.opacity.layout.clip_level_count]
        return SlotSums(alphas, self.sums, self.per_step)

    def emittance(self) -> EmittanceClipmap:
        """Return the emittance of all slots; the host reads how much light was lost."""
        layout = self.opacity.layout
        colors = []
        for level in layout.levels:
            count = DIRECTION_COUNT * level.voxel_count
            if level.level >= layout.clip_level_count:
                colors.append(dr.zeros(mi.Color3f, count))
                continue
            colors.append(self.slots.read(level.level, dr.arange(mi.UInt32, count), mi.Bool(True)))
        dr.eval(colors)
        return EmittanceClipmap(layout, colors, self.fallen.lost_flux_share)


def inject_all_levels(texels: Sequence[LightTexels], opacity: OpacityClipmap) -> SummedLight:
    """Sum the light of texels in the slots that they lie in.

    Parameters
    ----------
    texels
        Lit points of all lights.
    opacity
        Opacity at each clip level's own resolution, without derivatives.
    """
    layout = opacity.layout
    levels = layout.clip_levels
    total = mi.Float64(0.0)
    for each in texels:
        total += mi.Float64(each.sum())
    per_flux = mi.Float64([radiance_per_flux(level) for level in levels])
    steps, per_step = _powers_of_two(total * per_flux)
    dr.eval(total, steps, per_step)
    slot_count = _slot_count(opacity)
    sums = dr.empty(mi.Int64, len(levels) * slot_count * CHANNELS)
    slot = dr.arange(mi.UInt32, slot_count)
    for level in levels:
        is_covered = opacity.levels[level.level] > 0.0
        for channel in range(CHANNELS):
            place = CHANNELS * (slot + level.level * slot_count) + channel
            # Without the mode, Dr.Jit launches a channel before the next is added.
            dr.scatter(sums, mi.Int64(0), place, is_covered, dr.ReduceMode.NoConflicts)
    dr.eval(sums)
    target = _Target(opacity, sums, steps)
    parts = []
    for each in texels:
        parts.append(target.add(each))
        # One after the other, so that the kernel is the same however many there are.
        dr.eval(parts[-1], sums)
    fallen = FallenLight(len(levels), parts, [each.is_lit for each in texels])
    return SummedLight(opacity, sums, per_step, total, fallen)


def _slot_count(opacity: OpacityClipmap) -> int:
    """Slots of a clip level; all have as many."""
    return DIRECTION_COUNT * opacity.layout.levels[0].voxel_count


def _powers_of_two(total: mi.Float64) -> tuple[mi.Float64, mi.Float64]:
    """Return steps per unit that keep sums below their bound, and one over them; 0 of nothing."""
    bits = mi.UInt64(dr.reinterpret_array(mi.UInt64, total))
    mantissa = bits & ((1 << MANTISSA_BITS) - 1)
    exponent = (bits >> MANTISSA_BITS) + dr.select(mantissa != 0, mi.UInt64(1), 0)
    found = []
    for biased in (2 * EXPONENT_BIAS + SUM_BITS - exponent, exponent - SUM_BITS):
        number = mi.Float64(dr.reinterpret_array(mi.Float64, biased << MANTISSA_BITS))
        found.append(dr.select(total > 0.0, number, 0.0))
    return found[0], found[1]


class _Target:
    """Slots of all clip levels, and where their windows stand."""

    def __init__(self, opacity: OpacityClipmap, sums: mi.Int64, steps: mi.Float64) -> None:
        self.opacity, self.sums, self.steps = opacity, sums, steps
        self.levels = opacity.layout.clip_levels
        rows: list[int] = []
        for level in self.levels:
            finer = self.levels[level.level - 1].origin if level.level > 0 else 3 * (NEVER_INSIDE,)
            rows += [*level.origin, *finer]
        self.origins = mi.Int32(rows)
        self.voxel_sizes = mi.Float([level.voxel_size for level in self.levels])
        self.per_flux = mi.Float([radiance_per_flux(level) for level in self.levels])

    def add(self, texels: LightTexels) -> tuple[mi.UInt32, mi.Float, mi.Float]:
        """Add texels without evaluating the sums; return their levels, light found and lost."""
        level, texel = _lanes(texels, len(self.levels))
        position, normal = texels.position, texels.normal
        flux, is_lit = texels.reflected_flux, texels.is_lit
        if texel is not None:
            position = dr.gather(mi.Point3f, position, texel)
            normal = dr.gather(mi.Vector3f, normal, texel)
            flux = dr.gather(mi.Color3f, flux, texel)
            is_lit = dr.gather(mi.Bool, is_lit, texel)
        step = [dr.gather(mi.Float64, self.steps, level)]
        per_flux = dr.gather(mi.Float, self.per_flux, level)
        where = position / as_component(dr.gather(mi.Float, self.voxel_sizes, level))
        voxel = mi.Vector3i(dr.floor(where))
        found, lost = mi.Float(0.0), mi.Float(0.0)
        for axis in range(3):
            slot = surface_slot(mi.Float(normal[axis]), self.opacity.rule)
            value = flux * as_component(dr.abs(normal[axis]) * per_flux)
            light = [mi.Float(value[channel]) for channel in range(CHANNELS)]
            amounts = fixed_point(light, None, step)
            layers = filled_layers(mi.Float(where[axis]), slot)
            for number, (layer, is_filled) in enumerate(layers):
                filled = mi.Vector3i([layer if i == axis else mi.Int32(voxel[i]) for i in range(3)])
                is_active = is_lit & is_filled & self._holds(filled, level)
                index, alpha = self._slot(filled, level, 2 * axis + slot.side, is_active)
                is_seen = is_active & (alpha > 0.0)
                for channel, amount in enumerate(amounts):
                    place = CHANNELS * index + channel
                    mode = dr.ReduceMode.Direct
                    dr.scatter_reduce(dr.ReduceOp.Add, self.sums, amount, place, is_seen, mode)
                if number == 0:
                    mean = mi.Float((light[0] + light[1] + light[2]) * (1.0 / 3.0))
                    found += dr.select(is_seen, mean, 0.0)
                    lost += dr.select(is_active & ~is_seen, mean, 0.0)
        return level, found, lost

    def _holds(self, voxel: mi.Vector3i, level: mi.UInt32) -> mi.Bool:
        """Whether voxels lie in their level's window, and not in that of the next finer one."""
        inside, is_finer = mi.Bool(True), mi.Bool(True)
        resolution = self.levels[0].resolution
        for axis in range(3):
            own = dr.gather(mi.Int32, self.origins, 6 * level + axis)
            finer = dr.gather(mi.Int32, self.origins, 6 * level + (3 + axis))
            inside &= mi.UInt32(voxel[axis] - own) < resolution
            is_finer &= mi.UInt32(2 * voxel[axis] - finer) < resolution
        return inside & ~is_finer

    def _slot(
        self, voxel: mi.Vector3i, level: mi.UInt32, direction: mi.UInt32, active: mi.Bool
    ) -> tuple[mi.UInt32, mi.Float]:
        """Return the number of a slot among those of all levels, and its opacity."""
        count = self.levels[0].voxel_count
        index = texel_from_voxel(voxel, self.levels[0].resolution) + direction * count
        alphas = self.opacity.levels[: len(self.levels)]
        alpha = gather_own(alphas, level, index, active)
        return index + level * (DIRECTION_COUNT * count), alpha


def _lanes(texels: LightTexels, level_count: int) -> tuple[mi.UInt32, mi.UInt32 | None]:
    """Return the level of each lane, and its texel, None where lanes are texels.

    Texels that serve all levels have a lane for each.
    """
    if texels.level is not None:
        return texels.level, None
    count = dr.width(texels.position)
    lane = dr.arange(mi.UInt32, level_count * count)
    width = dr.maximum(mi.UInt32(IntegerRow([count, 0])[0]), 1)
    return lane // width, lane % width
