"""Voxelized surfaces as NumPy tables, by every way of finding coverage."""

from __future__ import annotations

from typing import get_args

import numpy as np

from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.surfaces import VoxelSurfaces, opaque_surfaces
from vctgi.stages.voxelization.opacity import (
    Coverage,
    OpacityVoxelizationConfig,
    voxelize_opacity,
)

METHODS: tuple[Coverage, ...] = get_args(Coverage)

AREA_STEP = {"cells": 1.0 / 64.0, "samples": 1.0 / 8.0, "analytic": 0.0}
"""What the smallest covered part of a face adds to its opacity."""

ROUNDING = {"cells": 0.0, "samples": 0.0, "analytic": 1e-6}
"""How far sums over the triangles of one surface may differ: bits do not, areas round."""


def window(resolution: int = 8, level_count: int = 1) -> ClipmapLayout:
    """Voxels of size 1 in the finest level; a single level has its lowest voxel at the origin."""
    return lay_out_clipmap(
        (0.5 * resolution,) * 3,
        finest_voxel_size=1.0,
        level_count=level_count,
        resolution=resolution,
    )


def voxelize(
    surfaces: VoxelSurfaces | np.ndarray, layout: ClipmapLayout, method: Coverage
) -> list[np.ndarray]:
    """Opacities [direction, z, y, x] of each clip level, its lowest voxel first."""
    if isinstance(surfaces, np.ndarray):
        surfaces = opaque_surfaces(surfaces)
    return tables(
        voxelize_opacity(
            surfaces, layout, OpacityVoxelizationConfig(coverage=method, is_complete=True)
        )
    )


def tables(opacity: OpacityClipmap) -> list[np.ndarray]:
    """Opacities [direction, z, y, x] of each clip level, its lowest voxel first."""
    found = []
    for level in opacity.layout.clip_levels:
        shape = (DIRECTION_COUNT,) + (level.resolution,) * 3
        table = np.array(opacity.levels[level.level], dtype=np.float64).reshape(shape)
        x, y, z = level.origin
        # Storage is toroidal.
        found.append(np.roll(table, (-z, -y, -x), axis=(1, 2, 3)))
    return found


def seen_along(table: np.ndarray, slot: int) -> np.ndarray:
    """Opacities of one slot as [depth, v, u]: its axis first, the others in cyclic order."""
    axis = slot // 2
    return np.transpose(table[slot], [2 - axis, 2 - (axis + 2) % 3, 2 - (axis + 1) % 3])


def on_axis(points: np.ndarray, axis: int) -> np.ndarray:
    """Turn points (u, v, depth) so that depth lies along an axis, u and v in cyclic order."""
    turned: np.ndarray = np.roll(points, axis + 1, axis=-1)
    return turned
