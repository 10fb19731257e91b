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
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import SlotRule, filled_layers, surface_slot
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.number_rows import IntegerRow
from vctgi.maths.recording import Recorder, run_recorded
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import FallenLight, LightTexels
from vctgi.stages.light_injection.config import LightInjectionConfig
from vctgi.stages.light_injection.splats import fixed_point, radiance_per_flux
from vctgi.stages.light_injection.summed_light import CHANNELS, SummedLight

SUM_BITS = 60
"""The sum of everything that is injected is below 2 to this power."""

MANTISSA_BITS, EXPONENT_BIAS = 52, 1023
"""Of numbers in double precision."""

NEVER_INSIDE = -(2**30)
"""Origin of a window that holds no voxel."""


def is_by_scatter(config: LightInjectionConfig) -> bool:
    """Whether a configuration asks for no more than is done here."""
    return (config.algorithm, config.prefilter, config.normalisation) == ("scatter", 1, "power")


def inject_all_levels(
    texels: Sequence[LightTexels], opacity: OpacityClipmap, recorder: Recorder | None = None
) -> SummedLight:
    """Sum the light of texels in the slots that they lie in.

    Parameters
    ----------
    texels
        Lit points of all lights.
    opacity
        Opacity at each clip level's own resolution, without derivatives.
    recorder
        Keeps what is traced; None: nobody does.
    """
    levels = opacity.layout.clip_levels
    injection = _Injection(len(levels), levels[0].resolution, opacity.rule)
    total = mi.Float64(0.0)
    for each in texels:
        total += mi.Float64(each.sum())
    lights = [_LaneTexels(each, *_lanes(each, len(levels))) for each in texels]
    if recorder is not None:
        dr.eval(lights)
        dr.make_opaque(total)
    inputs = (opacity.levels[: len(levels)], _WindowRows.of(levels), lights, total)
    # Whether light serves all levels is another kernel.
    key = ("light injection", injection, tuple(each.texel is None for each in lights))
    made = run_recorded(recorder, key, injection.inject, *inputs)
    parts = [(each.level, *both) for each, both in zip(lights, made.parts, strict=True)]
    fallen = FallenLight(len(levels), parts, [each.is_lit for each in texels])
    return SummedLight(opacity, made.sums, made.per_step, total, fallen)


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


@dataclass
class _WindowRows:
    """Windows of all clip levels on the device.

    Attributes
    ----------
    origins
        Flat [level, 6]: lowest voxel, and that of the next finer window.
    voxel_sizes
        [level + 1] world units, the last twice: Dr.Jit would make a single number a constant.
    per_flux
        [level + 1], as these: emittance that a watt adds to a voxel that faces it, m^-2 sr^-1.
    """

    origins: mi.Int32
    voxel_sizes: mi.Float
    per_flux: mi.Float64

    @classmethod
    def of(cls, levels: Sequence[LevelLayout]) -> _WindowRows:
        """Return the rows of clip levels."""
        rows: list[int] = []
        for level in levels:
            finer = levels[level.level - 1].origin if level.level > 0 else 3 * (NEVER_INSIDE,)
            rows += [*level.origin, *finer]
        ends = [*levels, levels[-1]]
        return cls(
            mi.Int32(rows),
            mi.Float([level.voxel_size for level in ends]),
            mi.Float64([radiance_per_flux(level) for level in ends]),
        )


@dataclass
class _LaneTexels:
    """Texels of a light, with a lane for each level that one serves.

    Attributes
    ----------
    texels
        The texels.
    level
        Clip level of each lane.
    texel
        Texel of each lane; None where lanes are texels.
    """

    texels: LightTexels
    level: mi.UInt32
    texel: mi.UInt32 | None


@dataclass
class _Injected:
    """What `_Injection.inject` returns: attributes of `SummedLight`.

    Attributes
    ----------
    parts
        Light found and lost of each lane, for each light.
    """

    sums: mi.Int64
    per_step: mi.Float64
    parts: list[tuple[mi.Float, mi.Float]]


@dataclass(frozen=True)
class _Injection:
    """How light is summed: all that kernels hold, which tells recordings apart.

    Attributes
    ----------
    level_count, resolution
        Clip levels, and voxels along an edge of each.
    rule
        How thick surfaces were made.
    """

    level_count: int
    resolution: int
    rule: SlotRule

    @property
    def slot_count(self) -> int:
        """Slots of a clip level."""
        return DIRECTION_COUNT * self.resolution**3

    def inject(
        self,
        alphas: list[mi.Float],
        windows: _WindowRows,
        lights: list[_LaneTexels],
        total: mi.Float64,
    ) -> _Injected:
        """Sum the light of all lights.

        Parameters
        ----------
        alphas
            Opacity of each clip level.
        windows
            Where the levels stand.
        lights
            Texels of lights.
        total
            Sum of the largest channels of all their flux, W.
        """
        steps, per_step = _powers_of_two(total * windows.per_flux)
        dr.eval(total, steps, per_step)
        sums = dr.empty(mi.Int64, self.level_count * self.slot_count * CHANNELS)
        slot = dr.arange(mi.UInt32, self.slot_count)
        for level, alpha in enumerate(alphas):
            is_covered = alpha > 0.0
            for channel in range(CHANNELS):
                place = CHANNELS * (slot + level * self.slot_count) + channel
                # Without the mode, Dr.Jit launches a channel before the next is added.
                dr.scatter(sums, mi.Int64(0), place, is_covered, dr.ReduceMode.NoConflicts)
        dr.eval(sums)
        target = _Target(self, alphas, windows, sums, steps)
        parts = []
        for light in lights:
            parts.append(target.add(light))
            # One after the other, so that the kernel is the same however many there are.
            dr.eval(parts[-1], sums)
        return _Injected(sums, per_step, parts)


@dataclass
class _Target:
    """Slots of all clip levels, to which light is added.

    Attributes
    ----------
    injection, alphas, windows
        How, and what `_Injection.inject` is given.
    sums, steps
        As `SummedLight.sums`, and steps per W m^-2 sr^-1 of each level.
    """

    injection: _Injection
    alphas: list[mi.Float]
    windows: _WindowRows
    sums: mi.Int64
    steps: mi.Float64

    def add(self, light: _LaneTexels) -> tuple[mi.Float, mi.Float]:
        """Add texels without evaluating the sums; return the light of each that is found, lost."""
        texels, level = light.texels, light.level
        position, normal = texels.position, texels.normal
        flux, is_lit = texels.reflected_flux, texels.is_lit
        if light.texel is not None:
            position = dr.gather(mi.Point3f, position, light.texel)
            normal = dr.gather(mi.Vector3f, normal, light.texel)
            flux = dr.gather(mi.Color3f, flux, light.texel)
            is_lit = dr.gather(mi.Bool, is_lit, light.texel)
        step = [dr.gather(mi.Float64, self.steps, level)]
        per_flux = mi.Float(dr.gather(mi.Float64, self.windows.per_flux, level))
        voxel_size = dr.gather(mi.Float, self.windows.voxel_sizes, level)
        where = position / as_component(voxel_size)
        voxel = mi.Vector3i(dr.floor(where))
        found, lost = mi.Float(0.0), mi.Float(0.0)
        for axis in range(3):
            slot = surface_slot(mi.Float(normal[axis]), self.injection.rule)
            value = flux * as_component(dr.abs(normal[axis]) * per_flux)
            colors = [mi.Float(value[channel]) for channel in range(CHANNELS)]
            amounts = fixed_point(colors, None, step)
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
                    mean = mi.Float((colors[0] + colors[1] + colors[2]) * (1.0 / 3.0))
                    found += dr.select(is_seen, mean, 0.0)
                    lost += dr.select(is_active & ~is_seen, mean, 0.0)
        return found, lost

    def _holds(self, voxel: mi.Vector3i, level: mi.UInt32) -> mi.Bool:
        """Whether voxels lie in their level's window, and not in that of the next finer one."""
        inside, is_finer = mi.Bool(True), mi.Bool(True)
        origins, resolution = self.windows.origins, self.injection.resolution
        for axis in range(3):
            own = dr.gather(mi.Int32, origins, 6 * level + axis)
            finer = dr.gather(mi.Int32, origins, 6 * level + (3 + axis))
            inside &= mi.UInt32(voxel[axis] - own) < resolution
            is_finer &= mi.UInt32(2 * voxel[axis] - finer) < resolution
        return inside & ~is_finer

    def _slot(
        self, voxel: mi.Vector3i, level: mi.UInt32, direction: mi.UInt32, active: mi.Bool
    ) -> tuple[mi.UInt32, mi.Float]:
        """Return the number of a slot among those of all levels, and its opacity."""
        resolution = self.injection.resolution
        index = texel_from_voxel(voxel, resolution) + direction * resolution**3
        alpha = gather_own(self.alphas, level, index, active)
        return index + level * self.injection.slot_count, alpha


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
