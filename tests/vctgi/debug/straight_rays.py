"""Rays and voxels whose picture is known."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of
from vctgi.clipmap.levels import ClipmapLayout, LevelLayout, lay_out_clipmap
from vctgi.debug.camera import PixelRays
from vctgi.debug.voxels import LevelVoxels, level_voxels
from vctgi.maths.directions import DIRECTION_COUNT

VOXEL = 0.5
"""Edge of a voxel, a power of two: positions on the lattice are exact."""


def one_level(centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> ClipmapLayout:
    return lay_out_clipmap(centre, finest_voxel_size=VOXEL, level_count=1, resolution=8)


def rays_of(origins: np.ndarray, directions: np.ndarray) -> PixelRays:
    """Rays [y, x, 3] from origins along directions, which need not be unit vectors."""
    directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    height, width = origins.shape[:2]

    def flat(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values.reshape(-1, 3).T, dtype=np.float32)

    return PixelRays(mi.Point3f(flat(origins)), mi.Vector3f(flat(directions)), width, height)


def rays_through_columns(level: LevelLayout, towards: int = 1) -> PixelRays:
    """One ray along +z or -z through the middle of each column of voxels, row by row."""
    edge = level.resolution
    steps = (np.arange(edge) + 0.5) * level.voxel_size
    x, y = np.meshgrid(steps + level.window_min[0], steps + level.window_min[1])
    start = level.window_min[2] - 1.0 if towards > 0 else level.window_max[2] + 1.0
    origins = np.stack([x, y, np.full_like(x, start)], axis=-1)
    directions = np.zeros_like(origins)
    directions[..., 2] = towards
    return rays_of(origins, directions)


def voxels_with(
    layout: ClipmapLayout, filled: list[tuple[tuple[int, int, int], int, float, list[float]]]
) -> LevelVoxels:
    """Voxels of a one-level layout: (voxel x y z of the world, slot, opacity, radiance)."""
    level = layout.levels[0]
    alphas = [np.zeros((DIRECTION_COUNT,) + (each.resolution,) * 3) for each in layout.levels]
    colors = [np.zeros((*a.shape, 3)) for a in alphas]
    for (x, y, z), slot, opacity, radiance in filled:
        place = (slot, z % level.resolution, y % level.resolution, x % level.resolution)
        alphas[0][place] = opacity
        colors[0][place] = opacity * np.array(radiance)
    return level_voxels(opacity_of(layout, alphas), 0, emittance_of(layout, colors))
