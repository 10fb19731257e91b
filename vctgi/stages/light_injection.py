"""Light injection: scatter the texels of reflective shadow maps into voxels.

A texel of reflected flux P on a surface of normal n adds P |n_k| / (pi v^2) to the slot of axis k
that sees the surface from its front: its outgoing radiance times the share of the voxel's face that
it covers. Sums are made in 64-bit fixed point, so they do not depend on the order of the scatter.
"""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import filled_layers, surface_slot
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT, other_axes
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
    levels, lost_shares = [], []
    for level in layout.levels:
        if level.level >= layout.clip_level_count:
            levels.append(dr.zeros(mi.Color3f, DIRECTION_COUNT * level.voxel_count))
            continue
        lighting = [m for m in maps if m.level in (None, level.level)]
        emittance, lost_share = _inject_level(lighting, opacity, level)
        levels.append(emittance)
        lost_shares.append(lost_share)
    return EmittanceClipmap(layout, levels, lost_shares)


def _inject_level(
    maps: list[ReflectiveShadowMap], opacity: OpacityClipmap, level: LevelLayout
) -> tuple[mi.Color3f, float]:
    """Emittance of one level, and the share of the flux in its window that was lost."""
    count = DIRECTION_COUNT * level.voxel_count
    total = sum(float(dr.sum(dr.max(m.reflected_flux))[0]) for m in maps)
    total *= _radiance_per_flux(level)
    if total == 0.0:
        return dr.zeros(mi.Color3f, count), 0.0
    if not math.isfinite(total):
        raise ValueError(
            "inject_light: the reflected flux of the scene's lights is not finite; "
            "check the emitters' power and the textures."
        )
    # A power of two keeps the scaling exact.
    scale = 2.0 ** (FIXED_POINT_BITS - math.ceil(math.log2(total)))
    sums = [dr.zeros(mi.Int64, count) for _ in range(3)]
    found, lost = 0.0, 0.0
    for rsm in maps:
        for axis in range(3):
            found_here, lost_here = _scatter(sums, rsm, opacity, level, axis, scale)
            found += found_here
            lost += lost_here
    emittance = mi.Color3f(*(mi.Float(mi.Float64(s) / scale) for s in sums))
    dr.eval(emittance)
    return emittance, lost / (found + lost) if found + lost > 0.0 else 0.0


def _scatter(
    sums: list[mi.Int64],
    rsm: ReflectiveShadowMap,
    opacity: OpacityClipmap,
    level: LevelLayout,
    axis: int,
    scale: float,
) -> tuple[float, float]:
    """Add the texels of one map to the slots of one axis; return what was found and lost."""
    alpha = opacity.levels[level.level]
    slot = surface_slot(mi.Float(rsm.normal[axis]), opacity.rule)
    value = rsm.reflected_flux * (dr.abs(rsm.normal[axis]) * _radiance_per_flux(level))
    place = rsm.position / level.voxel_size
    voxel = mi.Vector3i(dr.floor(place)) - mi.Vector3i(*level.origin)
    u, v = other_axes(axis)
    is_across = _is_held(mi.Int32(voxel[u]), level) & _is_held(mi.Int32(voxel[v]), level)

    found, lost = 0.0, 0.0
    for number, (layer, is_filled) in enumerate(filled_layers(mi.Float(place[axis]), slot)):
        depth = layer - level.origin[axis]
        active = is_across & is_filled & _is_held(depth, level)
        index = _slot_index(voxel, depth, axis, slot.side, level)
        is_seen = active & (dr.gather(mi.Float, alpha, index, active) > 0.0)
        for channel in range(3):
            amount = mi.Int64(dr.round(mi.Float64(value[channel]) * scale))
            dr.scatter_reduce(dr.ReduceOp.Add, sums[channel], amount, index, is_seen)
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


def _is_held(coordinate: mi.Int32, level: LevelLayout) -> mi.Bool:
    return (coordinate >= 0) & (coordinate < level.resolution)


def _slot_index(
    voxel: mi.Vector3i, depth: mi.Int32, axis: int, side: mi.UInt32, level: LevelLayout
) -> mi.UInt32:
    """Storage index of the slot of a voxel given relative to the window's corner."""
    local = [mi.Int32(coordinate) for coordinate in voxel]
    local[axis] = depth
    stored = texel_from_voxel(mi.Vector3i(local) + mi.Vector3i(*level.origin), level.resolution)
    return stored + (2 * axis + side) * level.voxel_count
