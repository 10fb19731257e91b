"""Splats: texels of lit points, each along one axis and in one of the layers that it fills.

A texel of reflected flux P on a surface of normal n adds P |n_k| / (pi v^2) to the slot of axis k
that sees the surface from its front: its outgoing radiance times the share of the voxel's face that
it covers. A pre-filter spreads this over slots around that one, each by its opacity times a kernel;
weights are divided by their sum, so nothing is lost and nothing goes where there is no surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel, window_test
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import SlotRule, filled_layers, surface_slot
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection.balance import drawing_power
from vctgi.stages.light_injection.config import LightInjectionConfig
from vctgi.stages.light_injection.kernels import Taps, scaled_taps, tap_weight


@dataclass
class CoveredSlots:
    """Where light may go in a level.

    Attributes
    ----------
    level
        The window.
    is_held
        Tells which voxels lie in it.
    is_finer
        Tells which voxels of the next finer level lie in its window, where they are lit; None if
        there is no such level.
    rule
        How thick surfaces were made.
    drawing
        [direction, z, y, x]: what the kernel's weight of each slot is multiplied by; 0 without
        opacity.
    taps
        Of the pre-filter along an axis; none without one.
    """

    level: LevelLayout
    is_held: Callable[[mi.Vector3i], mi.Bool]
    is_finer: Callable[[mi.Vector3i], mi.Bool] | None
    rule: SlotRule
    drawing: mi.Float
    taps: Taps


def covered_slots(
    opacity: OpacityClipmap, level: LevelLayout, width: int, scale: mi.Float | None = None
) -> CoveredSlots:
    """Return the slots of a level that have opacity, for a pre-filter of this width and scale."""
    alpha = opacity.levels[level.level]
    taps = scaled_taps(width, scale) if width > 1 else ()
    drawing = alpha if width == 1 else drawing_power(alpha, level, width, taps)
    finer = window_test(opacity.layout.levels[level.level - 1]) if level.level > 0 else None
    return CoveredSlots(level, window_test(level), finer, opacity.rule, drawing, taps)


@dataclass
class Splats:
    """Light of the texels of a map along one axis, in one layer, a lane each.

    Attributes
    ----------
    number
        Of the layer; 0 is the one that holds the surface itself.
    voxel
        Voxel that is filled.
    offset
        Place of the texel within it, from its middle, voxels.
    direction
        Slot that is filled.
    is_active
        Lanes that fill this layer within the window.
    per_weight
        One over the sum of the weights of all slots, 0 where none has opacity.
    light
        Channels that are summed: radiance times covered share, W m^-2 sr^-1, and with
        `normalisation` "radiance" three more, that times the surface's radiance.
    """

    number: int
    voxel: mi.Vector3i
    offset: mi.Vector3f
    direction: mi.UInt32
    is_active: mi.Bool
    per_weight: mi.Float
    light: list[mi.Float]

    @property
    def is_seen(self) -> mi.Bool:
        """Lanes that find opacity to go to."""
        return self.is_active & (self.per_weight > 0.0)


def radiance_per_flux(level: LevelLayout) -> float:
    """Emittance that a watt of reflected flux adds to a voxel which faces it squarely."""
    return 1.0 / (math.pi * level.voxel_size**2)


def neighbour(number: mi.UInt32, width: int) -> mi.Vector3i:
    """Step from the middle of a box of `width`^3 voxels to its voxel of this number."""
    x, y, z = number % width, (number // width) % width, number // (width * width)
    return mi.Vector3i(mi.Int32(x), mi.Int32(y), mi.Int32(z)) - width // 2


def kernel_weight(step: mi.Vector3i, taps: Taps) -> mi.Float:
    """Weight of the voxel `step` away from the one that a splat lies in."""
    x, y, z = (tap_weight(mi.Int32(step[axis]), taps) for axis in range(3))
    return x * y * z


def splat_light(
    rsm: ReflectiveShadowMap, level: LevelLayout, axis: int, channel_count: int
) -> list[mi.Float]:
    """Return what texels add to a slot along an axis, as `Splats.light`."""
    value = rsm.reflected_flux * (dr.abs(rsm.normal[axis]) * radiance_per_flux(level))
    light = [mi.Float(value[channel]) for channel in range(3)]
    if channel_count > 3:
        assert rsm.radiance is not None, "injection asks for the radiance before it makes splats"
        light += [light[channel] * mi.Float(rsm.radiance[channel]) for channel in range(3)]
    return light


def make_splats(
    rsm: ReflectiveShadowMap,
    covered: CoveredSlots,
    axis: int,
    config: LightInjectionConfig,
) -> Iterator[Splats]:
    """Yield the splats of a map along an axis, layer by layer, nearest first."""
    level = covered.level
    slot = surface_slot(mi.Float(rsm.normal[axis]), covered.rule)
    is_bounded = config.normalisation == "radiance" and config.algorithm != "centre"
    light = splat_light(rsm, level, axis, 6 if is_bounded else 3)
    where = rsm.position / level.voxel_size
    voxel = mi.Vector3i(dr.floor(where))
    offset = mi.Vector3f(where - mi.Point3f(voxel)) - 0.5
    for number, (layer, is_filled) in enumerate(filled_layers(mi.Float(where[axis]), slot)):
        filled = mi.Vector3i([layer if i == axis else mi.Int32(voxel[i]) for i in range(3)])
        is_active = is_filled & covered.is_held(filled)
        if covered.is_finer is not None:
            is_active &= ~covered.is_finer(2 * filled)
        splats = Splats(
            number=number,
            voxel=filled,
            offset=offset,
            direction=2 * axis + slot.side,
            is_active=is_active,
            per_weight=mi.Float(0.0),
            light=light,
        )
        splats.per_weight = _per_weight(splats, covered, config.prefilter)
        if config.prefilter > 1 or config.algorithm == "gather":
            # Computed once, so that every kernel that reads them reads the same numbers.
            dr.eval(splats.voxel, splats.offset, splats.direction, splats.is_active)
            dr.eval(splats.per_weight, splats.light)
        yield splats


def _per_weight(splats: Splats, covered: CoveredSlots, width: int) -> mi.Float:
    """One over the sum of the weights of the covered slots around each splat."""
    level = covered.level
    block = splats.direction * level.voxel_count

    def drawing_at(voxel: mi.Vector3i, active: mi.Bool) -> mi.Float:
        texel = texel_from_voxel(voxel, level.resolution)
        return dr.gather(mi.Float, covered.drawing, texel + block, active)

    if width == 1:
        return dr.select(drawing_at(splats.voxel, splats.is_active) > 0.0, mi.Float(1.0), 0.0)
    lanes = dr.width(splats.voxel)

    def add_one(number: mi.UInt32, total: mi.Float) -> tuple[mi.UInt32, mi.Float]:
        step = neighbour(number, width)
        voxel = splats.voxel + step
        held = drawing_at(voxel, splats.is_active & covered.is_held(voxel))
        return number + 1, dr.fma(kernel_weight(step, covered.taps), held, total)

    _, total = dr.while_loop(
        state=(dr.zeros(mi.UInt32, lanes), dr.zeros(mi.Float, lanes)),
        cond=lambda number, total: number < width**3,
        body=add_one,
        labels=("number", "total"),
        label="sum_weights",
    )
    has_weight = total > 0.0
    return mi.Float(dr.select(has_weight, 1.0 / dr.select(has_weight, total, 1.0), 0.0))


def fixed_point(
    light: list[mi.Float], weight: mi.Float | None, steps: list[mi.Float64]
) -> list[mi.Int64]:
    """Return weighed light in fixed-point steps, channel by channel."""
    amounts = []
    for channel, value in enumerate(light):
        part = value if weight is None else value * weight
        amounts.append(mi.Int64(dr.round(mi.Float64(part) * steps[channel // 3])))
    return amounts
