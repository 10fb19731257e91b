"""Light injection: scatter the texels of reflective shadow maps into voxels.

A texel of reflected flux P on a surface of normal n adds P |n_k| / (pi v^2) to the slot of axis k
that sees the surface from its front: its outgoing radiance times the share of the voxel's face that
it covers. Sums are made in 64-bit fixed point, so they do not depend on the order of the scatter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import is_inside, texel_from_voxel, voxel_of_place
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.regions import Region, newly_covered_regions, own_regions
from vctgi.clipmap.slots import filled_layers, surface_slot
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.records import ReflectiveShadowMap

FIXED_POINT_BITS = 60
"""The sum of everything that is injected is below 2 to this power."""


def inject_light(maps: list[ReflectiveShadowMap], opacity: OpacityClipmap) -> EmittanceClipmap:
    """Turn lit points into emittance.

    Parameters
    ----------
    maps
        Lit points; those made for one level light only that level.
    opacity
        Opacity at each clip level's own resolution. Light goes only where it is not zero: what has
        no opacity is never seen.

    Returns
    -------
    EmittanceClipmap
        Zero in the mips; the share of flux that found no opacity is kept for each clip level.

    References
    ----------
    [Panteleev2014], slides "Light injection".
    """
    layout = opacity.layout
    dark = EmittanceClipmap(
        layout,
        [dr.zeros(mi.Color3f, DIRECTION_COUNT * level.voxel_count) for level in layout.levels],
        [0.0] * layout.clip_level_count,
        [0.0] * layout.clip_level_count,
    )
    whole = [own_regions(layout, level) for level in layout.clip_levels]
    return update_emittance(dark, maps, opacity, whole)


def update_emittance(
    emittance: EmittanceClipmap,
    maps: list[ReflectiveShadowMap],
    opacity: OpacityClipmap,
    stale: Sequence[Sequence[Region]],
) -> EmittanceClipmap:
    """Light anew what became stale.

    Parameters
    ----------
    emittance
        What `inject_light` or an earlier update returned; used up, its arrays are changed.
    maps
        All lit points as they are now.
    opacity
        Opacity at each clip level's own resolution, as it is now.
    stale
        Boxes of each level whose surfaces, opacity or light changed; all else must be as it was.

    Returns
    -------
    EmittanceClipmap
        The same, bit for bit, as `inject_light` of all of it.
    """
    layout = opacity.layout
    _darken(emittance.levels, newly_covered_regions(emittance.layout, layout))
    lit = EmittanceClipmap(layout, emittance.levels, [], [])
    for level in layout.clip_levels:
        lighting = [m for m in maps if m.level in (None, level.level)]
        steps = _steps_per_unit(lighting, level)
        # Light summed in other steps is rounded otherwise: then all of it is summed again.
        is_kept = steps == emittance.steps_per_unit[level.level]
        boxes = list(stale[level.level]) if is_kept else own_regions(layout, level)
        lit.lost_flux_share.append(_fill(lit, lighting, opacity, boxes, steps, level))
        lit.steps_per_unit.append(steps)
    return lit


def _darken(levels: list[mi.Color3f], boxes: Sequence[Region]) -> None:
    """Set the emittance in boxes to zero; `levels` are changed in place."""
    for box in boxes:
        count = dr.opaque(mi.UInt32, box.voxel_count)
        lane = dr.arange(mi.UInt32, DIRECTION_COUNT * box.voxel_count)
        texel = texel_from_voxel(voxel_of_place(lane % count, [box]), box.level.resolution)
        index = texel + lane // count * box.level.voxel_count
        dr.scatter(levels[box.level.level], mi.Color3f(0.0), index)
        dr.eval(levels[box.level.level])


def _steps_per_unit(maps: list[ReflectiveShadowMap], level: LevelLayout) -> float:
    """Fixed-point steps per unit of emittance, a power of two; 0 without light."""
    total = sum(float(dr.sum(dr.max(m.reflected_flux))[0]) for m in maps)
    total *= _radiance_per_flux(level)
    if total == 0.0:
        return 0.0
    if not math.isfinite(total):
        raise ValueError(
            "inject_light: the reflected flux of the scene's lights is not finite; "
            "check the emitters' power and the textures."
        )
    return 2.0 ** (FIXED_POINT_BITS - math.ceil(math.log2(total)))


@dataclass
class _Target:
    """Boxes of a level that are lit, as places in a list of their voxels."""

    place: mi.UInt32  # of each texel of the level; NOWHERE outside the boxes
    count: mi.UInt32
    sums: list[mi.Int64]


NOWHERE = 0xFFFFFFFF
"""Place of a voxel that is not lit anew."""


def _fill(
    lit: EmittanceClipmap,
    maps: list[ReflectiveShadowMap],
    opacity: OpacityClipmap,
    boxes: list[Region],
    steps: float,
    level: LevelLayout,
) -> float:
    """Overwrite the emittance in boxes of a level; return the share of flux that was lost."""
    count = sum(box.voxel_count for box in boxes)
    place = dr.full(mi.UInt32, NOWHERE, level.voxel_count)
    if count:
        lane = dr.arange(mi.UInt32, count)
        texel = texel_from_voxel(voxel_of_place(lane, boxes), level.resolution)
        dr.scatter(place, lane, texel)
    sums = [dr.zeros(mi.Int64, max(1, DIRECTION_COUNT * count)) for _ in range(3)]
    target = _Target(place, dr.opaque(mi.UInt32, count), sums)
    found, lost = 0.0, 0.0
    for rsm in maps:
        for axis in range(3):
            found_here, lost_here = _scatter(target, rsm, opacity, level, axis, steps)
            found += found_here
            lost += lost_here
    if count:
        lane = dr.arange(mi.UInt32, DIRECTION_COUNT * count)
        voxel = voxel_of_place(lane % target.count, boxes)
        texel = texel_from_voxel(voxel, level.resolution)
        # A place that two boxes share has light in the one that came last; both are given it.
        held = dr.gather(mi.UInt32, place, texel) + lane // target.count * target.count
        per_step = dr.opaque(mi.Float64, 1.0 / steps if steps else 0.0)
        emitted = [mi.Float(mi.Float64(dr.gather(mi.Int64, s, held)) * per_step) for s in sums]
        index = texel + lane // target.count * level.voxel_count
        dr.scatter(lit.levels[level.level], mi.Color3f(*emitted), index)
        dr.eval(lit.levels[level.level])
    return lost / (found + lost) if found + lost > 0.0 else 0.0


def _scatter(
    target: _Target,
    rsm: ReflectiveShadowMap,
    opacity: OpacityClipmap,
    level: LevelLayout,
    axis: int,
    steps: float,
) -> tuple[float, float]:
    """Add the texels of one map to the slots of one axis; return what was found and lost."""
    slot = surface_slot(mi.Float(rsm.normal[axis]), opacity.rule)
    value = rsm.reflected_flux * (dr.abs(rsm.normal[axis]) * _radiance_per_flux(level))
    where = rsm.position / level.voxel_size
    voxel = mi.Vector3i(dr.floor(where))
    scale = dr.opaque(mi.Float64, steps)

    found, lost = 0.0, 0.0
    for number, (layer, is_filled) in enumerate(filled_layers(mi.Float(where[axis]), slot)):
        filled = mi.Vector3i([layer if i == axis else mi.Int32(voxel[i]) for i in range(3)])
        active = is_filled & is_inside(filled, level)
        if level.level > 0:
            # What a finer window covers is downsampled from there.
            finer = opacity.layout.levels[level.level - 1]
            active &= ~is_inside(2 * filled, finer)
        texel = texel_from_voxel(filled, level.resolution)
        direction = 2 * axis + slot.side
        alpha = opacity.levels[level.level]
        index = texel + direction * level.voxel_count
        is_seen = active & (dr.gather(mi.Float, alpha, index, active) > 0.0)
        place = dr.gather(mi.UInt32, target.place, texel, active)
        is_stale = is_seen & (place != NOWHERE)
        for channel in range(3):
            amount = mi.Int64(dr.round(mi.Float64(value[channel]) * scale))
            dr.scatter_reduce(
                dr.ReduceOp.Add,
                target.sums[channel],
                amount,
                place + direction * target.count,
                is_stale,
                dr.ReduceMode.Direct,
            )
        if number == 0:
            brightness = mi.Float(dr.mean(value))
            found = _total(brightness, is_seen)
            lost = _total(brightness, active & ~is_seen)
    return found, lost


def _radiance_per_flux(level: LevelLayout) -> float:
    """Emittance that a watt of reflected flux adds to a voxel which faces it squarely."""
    return 1.0 / (math.pi * level.voxel_size**2)


def _total(value: mi.Float, active: mi.Bool) -> float:
    held = dr.select(active, value, 0.0)
    return float(dr.sum(held)[0])
