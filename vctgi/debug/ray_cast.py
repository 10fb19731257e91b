"""Rays through the voxels of one level, voxel by voxel, without any filtering.

The traversal is Dr.Jit's own grid walk, in double precision and in voxels of the level, so that
what is seen is exactly what is stored, however far from the origin the window lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
from drjit.dda import dda

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.debug.camera import PixelRays
from vctgi.debug.voxels import LevelVoxels
from vctgi.maths.stub_gaps import as_component

VISIBLE_OPACITY = 0.1
"""A voxel is shown when a slot that faces the ray has at least this opacity: low enough that the
parts of a slanted plane, which share its coverage, leave no holes."""

LEAST_TRANSMITTANCE = 1e-4
"""A composed ray that lets less through has ended."""

SMALLEST_CLEAR = 1e-12
"""Least share of light that one voxel passes, so that its logarithm is finite."""


@dataclass
class VoxelHits:
    """The first visible voxel along each ray.

    Attributes
    ----------
    is_hit
        Whether there is one.
    texel
        Its storage index within the level; 0 where there is none.
    entry
        Where the ray enters it, in voxels from its lowest corner, each coordinate in [0, 1].
    depth
        Distance to that point, world units; 0 where there is none.
    direction
        Unit directions of the rays.
    """

    is_hit: mi.Bool
    texel: mi.UInt32
    entry: mi.Vector3f
    depth: mi.Float
    direction: mi.Vector3f


def facing_slots(direction: mi.Vector3f) -> list[mi.UInt32]:
    """Return for each axis the slot that a ray meets, from its direction of travel."""
    return [
        dr.select(direction[axis] < 0.0, mi.UInt32(2 * axis + 1), mi.UInt32(2 * axis))
        for axis in range(3)
    ]


def facing_opacities(
    voxels: LevelVoxels, texel: mi.UInt32, direction: mi.Vector3f, active: mi.Bool
) -> list[mi.Float]:
    """Return the opacity of the slot that the ray meets along each axis, 0 where it runs across."""
    count = voxels.level.voxel_count
    return [
        dr.gather(mi.Float, voxels.opacity, texel + slot * count, active & (direction[axis] != 0.0))
        for axis, slot in enumerate(facing_slots(direction))
    ]


def opacity_along(
    opacities: list[mi.Float], direction: mi.Vector3f, path: mi.Float | float = 1.0
) -> mi.Float:
    """Return the share of light that a voxel stops along a slanted path.

    The projected-area rule of the cones, without their cap: 1 - prod_k (1 - a_k)^(|d_k| path).

    Parameters
    ----------
    opacities
        Of the slots that face the ray, one an axis.
    direction
        Unit direction of the ray.
    path
        Length of the path, in voxels.
    """
    depth = mi.Float(0.0)
    for axis, opacity in enumerate(opacities):
        share = -dr.log(dr.maximum(1.0 - opacity, SMALLEST_CLEAR))
        depth = dr.fma(mi.Float(dr.abs(direction[axis])), share, depth)
    return 1.0 - dr.exp(-depth * path)


def first_voxels(
    voxels: LevelVoxels, rays: PixelRays, threshold: float = VISIBLE_OPACITY
) -> VoxelHits:
    """Find the first voxel along each ray whose front is turned to it.

    Parameters
    ----------
    voxels
        One level.
    rays
        Where to look from. The voxel that a ray starts in is not shown: it would fill the picture.
    threshold
        Least opacity, (0, 1], of a slot facing the ray, the largest of the three axes. Slots are
        one-sided, so voxels are not seen from behind.

    Raises
    ------
    ValueError
        A threshold that every voxel, or none, would meet.
    """
    if not 0.0 < threshold <= 1.0:
        raise ValueError(f"first_voxels: threshold must be in (0, 1], got {threshold}.")
    direction = rays.direction
    start = _in_voxels(voxels, rays)
    home = mi.Vector3i(dr.floor(start))

    def visit(state: Any, index: Any, p_in: Any, _p_out: Any, active: Any) -> tuple[Any, Any]:
        is_hit, texel, cell, entry = state
        here = mi.Vector3i(index[2], index[1], index[0])
        there = texel_from_voxel(here + mi.Vector3i(*voxels.level.origin), voxels.level.resolution)
        met = active & dr.any(here != home)
        opacities = facing_opacities(voxels, there, direction, met)
        found = met & (dr.maximum(dr.maximum(*opacities[:2]), opacities[2]) >= threshold)
        state = (
            is_hit | found,
            dr.select(found, there, texel),
            dr.select(found, here, cell),
            dr.select(found, mi.Vector3d(p_in), entry),
        )
        return state, ~found

    count = dr.width(direction)
    empty = (
        dr.full(mi.Bool, False, count),
        dr.zeros(mi.UInt32, count),
        dr.zeros(mi.Vector3i, count),
        dr.zeros(mi.Vector3d, count),
    )
    is_hit, texel, cell, entry = _walk(voxels, start, direction, visit, empty)
    reached = dr.norm(mi.Vector3d(cell) + entry - start) * voxels.level.voxel_size
    depth = mi.Float(dr.select(is_hit, reached, 0.0))
    hits = VoxelHits(is_hit, texel, mi.Vector3f(entry), depth, direction)
    dr.eval(hits)
    return hits


def compose_voxels(voxels: LevelVoxels, rays: PixelRays) -> tuple[mi.Color3f, mi.Float]:
    """See through the voxels, front to back, along hair-thin rays.

    Parameters
    ----------
    voxels
        One level.
    rays
        Where to look from.

    Returns
    -------
    tuple
        Radiance that arrives, W m^-2 sr^-1, and the share of light that the voxels stop, [0, 1].

    Notes
    -----
    Each voxel stops light along the ray's path through it by `opacity_along`; what it stops it
    replaces by the radiance of the slots that face the ray.
    """
    direction = rays.direction

    def visit(state: Any, index: Any, p_in: Any, p_out: Any, active: Any) -> tuple[Any, Any]:
        passed, seen = state
        here = mi.Vector3i(index[2], index[1], index[0])
        texel = texel_from_voxel(here + mi.Vector3i(*voxels.level.origin), voxels.level.resolution)
        path = mi.Float(dr.norm(mi.Vector3d(p_out) - mi.Vector3d(p_in)))
        opacities = facing_opacities(voxels, texel, direction, active)
        stopped = dr.select(active, opacity_along(opacities, direction, path), 0.0)
        radiance = facing_radiance(voxels, voxels.emittance, texel, direction, opacities)
        seen = dr.fma(as_component(passed * stopped), radiance, seen)
        passed = passed * (1.0 - stopped)
        return (passed, seen), passed > LEAST_TRANSMITTANCE

    count = dr.width(direction)
    begin = (dr.full(mi.Float, 1.0, count), dr.zeros(mi.Color3f, count))
    passed, seen = _walk(voxels, _in_voxels(voxels, rays), direction, visit, begin)
    opacity = 1.0 - passed
    dr.eval(seen, opacity)
    return seen, opacity


def facing_radiance(
    voxels: LevelVoxels,
    emittance: mi.Color3f,
    texel: mi.UInt32,
    direction: mi.Vector3f,
    weights: list[mi.Float],
) -> mi.Color3f:
    """Return premultiplied values of the slots that face a ray over their weights, 0 for none.

    Parameters
    ----------
    voxels
        One level.
    emittance
        Values of its slots, flat [direction, z, y, x].
    texel, direction
        Which voxel, and how the ray travels.
    weights
        What the values are multiplied with, of the facing slot of each axis; its opacity.
    """
    total, value = mi.Float(0.0), mi.Color3f(0.0)
    for axis, slot in enumerate(facing_slots(direction)):
        share = mi.Float(dr.abs(direction[axis]))
        active = weights[axis] > 0.0
        held = dr.gather(mi.Color3f, emittance, texel + slot * voxels.level.voxel_count, active)
        value = dr.fma(as_component(share), held, value)
        total = dr.fma(share, weights[axis], total)
    is_there = total > 0.0
    return dr.select(is_there, value / as_component(dr.select(is_there, total, 1.0)), 0.0)


def _in_voxels(voxels: LevelVoxels, rays: PixelRays) -> mi.Vector3d:
    """Return where rays start, in voxels from the corner of the window."""
    level = voxels.level
    return mi.Vector3d(rays.origin) / level.voxel_size - mi.Vector3d(*level.origin)


def _walk(
    voxels: LevelVoxels, start: mi.Vector3d, direction: mi.Vector3f, visit: Any, state: Any
) -> Any:
    """Visit the voxels of the window along rays with Dr.Jit's grid walk."""
    dr.eval(voxels)
    edge = voxels.level.resolution
    # The walk wants Dr.Jit's plain arrays, not Mitsuba's vectors.
    plain: Any = dr.float64_array_t(mi.Vector3f)
    whole: Any = dr.uint32_array_t(mi.Vector3f)
    return dda(
        ray_o=plain(start),
        ray_d=plain(mi.Vector3d(direction)),
        ray_max=mi.Float64(dr.inf),
        grid_res=whole(edge),
        grid_min=plain(0.0),
        grid_max=plain(float(edge)),
        func=visit,
        state=state,
        active=dr.full(mi.Bool, True, dr.width(direction)),
    )
