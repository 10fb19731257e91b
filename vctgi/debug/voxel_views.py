"""What each voxel holds, as the camera sees the voxels of one level.

Opacity, radiance, albedo and normal of the first visible voxel of each pixel, and lines that tell
voxels apart. All numbers are those of the voxel, nothing is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.debug.camera import PixelRays
from vctgi.debug.ray_cast import (
    VISIBLE_OPACITY,
    VoxelHits,
    facing_opacities,
    facing_radiance,
    first_voxels,
    opacity_along,
)
from vctgi.debug.surface_albedo import VoxelAlbedo
from vctgi.debug.voxels import LevelVoxels
from vctgi.maths.stub_gaps import as_component

CANCELLED = 0.05
"""Slots of opposite directions whose difference is below this share of their sum say nothing about
a normal: the voxel holds both sides of a sheet, or a wall thinner than itself."""

EDGE_SHADE = 0.6
"""Brightness of the line around a voxel."""

LINE_PIXELS = 0.7
"""Half width of that line, pixels."""

FAINT_PIXELS, CLEAR_PIXELS = 4.0, 12.0
"""Lines fade in as voxels grow from the one to the other; below, there would be nothing else."""


@dataclass
class VoxelView:
    """Pictures of one level, each [y, x] or [y, x, 3].

    Attributes
    ----------
    level
        Which level.
    is_hit
        Whether there is a visible voxel; all else is 0 where there is none.
    depth
        Distance to it, world units.
    opacity
        Share of light that it stops along the ray, over a path of one voxel, [0, 1].
    radiance
        Emittance over opacity of the slots that face the ray, W m^-2 sr^-1.
    albedo
        Mean albedo of the surfaces in these slots, [0, 1]; NaN where no sample landed.
    normal
        Unit mean normal, from all six slots; where opposite ones cancel, from those facing the ray.
    shade
        Factor that darkens the edges of voxels, (0, 1].
    """

    level: int
    is_hit: np.ndarray
    depth: np.ndarray
    opacity: np.ndarray
    radiance: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    shade: np.ndarray


def view_voxels(
    voxels: LevelVoxels,
    rays: PixelRays,
    albedo: VoxelAlbedo,
    threshold: float = VISIBLE_OPACITY,
) -> VoxelView:
    """Return the pictures of one level.

    Parameters
    ----------
    voxels
        The level.
    rays
        Camera.
    albedo
        Albedo of the same level.
    threshold
        Least opacity of a voxel that is shown (`first_voxels`).
    """
    hits = first_voxels(voxels, rays, threshold)
    opacities = facing_opacities(voxels, hits.texel, hits.direction, hits.is_hit)
    radiance = facing_radiance(voxels, voxels.emittance, hits.texel, hits.direction, opacities)
    samples = facing_opacities(albedo.sampled_in(voxels), hits.texel, hits.direction, hits.is_hit)
    reflected = facing_radiance(voxels, albedo.reflected, hits.texel, hits.direction, samples)
    is_sampled = (samples[0] > 0.0) | (samples[1] > 0.0) | (samples[2] > 0.0)
    seen = opacity_along(opacities, hits.direction)
    dr.eval(radiance, reflected, seen)
    return VoxelView(
        level=voxels.level.level,
        is_hit=rays.picture(hits.is_hit),
        depth=rays.picture(hits.depth),
        opacity=rays.picture(dr.select(hits.is_hit, seen, 0.0)),
        radiance=rays.picture(radiance),
        albedo=rays.picture(dr.select(hits.is_hit & ~is_sampled, dr.nan, reflected)),
        normal=rays.picture(mean_normal(voxels, hits)),
        shade=edge_shade(hits, rays, voxels.level.voxel_size),
    )


def mean_normal(voxels: LevelVoxels, hits: VoxelHits) -> mi.Vector3f:
    """Return the unit mean normal of the surfaces in a voxel.

    Slot +k holds surfaces with n_k < 0, weighted by |n_k| through their projected area, so the
    difference of slots -k and +k is proportional to n_k. Where a voxel holds both sides of a sheet
    nothing is left of it; then the slots that the ray meets tell what it sees.
    """
    net, facing = [], []
    total = mi.Float(0.0)
    for axis in range(3):
        upper, lower = (
            dr.gather(
                mi.Float,
                voxels.opacity,
                hits.texel + (2 * axis + side) * voxels.level.voxel_count,
                hits.is_hit,
            )
            for side in (1, 0)
        )
        net.append(upper - lower)
        facing.append(dr.select(hits.direction[axis] < 0.0, upper, -lower))
        total += upper + lower
    is_clear = dr.norm(mi.Vector3f(*net)) > CANCELLED * total
    normal = dr.select(is_clear, mi.Vector3f(*net), mi.Vector3f(*facing))
    length = mi.Float(dr.norm(normal))
    is_there = length > 0.0
    return dr.select(is_there, normal / as_component(dr.select(is_there, length, 1.0)), 0.0)


def edge_shade(hits: VoxelHits, rays: PixelRays, voxel_size: float) -> np.ndarray:
    """Return a factor [y, x] that draws faint lines along the edges of voxels."""
    entry = rays.picture(hits.entry).astype(np.float64)
    depth = rays.picture(hits.depth).astype(np.float64)
    is_hit = rays.picture(hits.is_hit)
    # On a face one coordinate is 0 or 1; the next nearest one tells how far the edge is.
    from_edge = np.sort(np.minimum(entry, 1.0 - entry), axis=-1)[..., 1] * voxel_size
    # Nearer than a millionth of a voxel an edge is as clear as it gets.
    pixel = np.maximum(depth * rays.pixel_angle, 1e-6 * voxel_size)
    clarity = np.clip((voxel_size / pixel - FAINT_PIXELS) / (CLEAR_PIXELS - FAINT_PIXELS), 0.0, 1.0)
    is_line = is_hit & (from_edge < LINE_PIXELS * pixel)
    shade: np.ndarray = np.where(is_line, 1.0 - clarity * (1.0 - EDGE_SHADE), 1.0)
    return shade.astype(np.float32)
