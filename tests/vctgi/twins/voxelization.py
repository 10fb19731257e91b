"""Opacity voxelization, cell by cell: the definition, with no care for speed."""

from __future__ import annotations

import numpy as np

from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import BEHIND_NUDGE, SlotRule
from vctgi.maths.directions import DIRECTION_COUNT, other_axes
from vctgi.stages.voxelization.columns import CELLS_PER_EDGE, EDGE_TOLERANCE
from vctgi.stages.voxelization.opacity import DEFAULT_CONFIG, OpacityVoxelizationConfig
from vctgi.stages.voxelization.triangles import FLAT_NORMAL


def voxelize(
    vertices: np.ndarray,
    level: LevelLayout,
    config: OpacityVoxelizationConfig = DEFAULT_CONFIG,
) -> np.ndarray:
    """Return the opacity [direction, z, y, x] of triangles [triangle, corner, 3]."""
    edge = level.resolution
    cells = CELLS_PER_EDGE * config.supersampling(level.level)
    covered = np.zeros((DIRECTION_COUNT, edge, edge, edge, cells, cells), bool)
    for triangle in vertices:
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        normal = normal / np.linalg.norm(normal)
        for axis in range(3):
            if abs(normal[axis]) >= FLAT_NORMAL:
                _mark(covered, triangle / level.voxel_size, normal, axis, level, config.slots)
    if config.is_two_sided:
        covered |= covered[[1, 0, 3, 2, 5, 4]]
    share: np.ndarray = covered.sum(axis=(-1, -2)) / cells**2
    return share


def _mark(
    covered: np.ndarray,
    triangle: np.ndarray,
    normal: np.ndarray,
    axis: int,
    level: LevelLayout,
    rule: SlotRule,
) -> None:
    """Set the cells that a triangle, in voxels, covers when it is seen along an axis."""
    u, v = other_axes(axis)
    lowest = np.array(level.origin)
    cells = covered.shape[-1]
    faces_lower = normal[axis] < 0.0
    behind = 1 if faces_lower else -1
    slot = 2 * axis + (0 if faces_lower else 1)
    # The renderer keeps normals in single precision.
    is_sloped = np.float32(abs(normal[axis])) < np.float32(rule.sloped_below)
    thickness = rule.thickness_voxels if is_sloped else 0.0
    centre = (np.arange(level.resolution * cells) + 0.5) / cells
    grid_v, grid_u = np.meshgrid(centre + lowest[v], centre + lowest[u], indexing="ij")
    inside = _is_inside(triangle[:, u], triangle[:, v], grid_u, grid_v, EDGE_TOLERANCE / cells)
    for cell_v, cell_u in zip(*np.nonzero(inside), strict=True):
        slope_u = normal[u] * (grid_u[cell_v, cell_u] - triangle[0, u])
        slope_v = normal[v] * (grid_v[cell_v, cell_u] - triangle[0, v])
        depth = triangle[0, axis] - (slope_u + slope_v) / normal[axis]
        # A cell at the rim may lie outside by the tolerance; its depth does not.
        depth = np.clip(depth, triangle[:, axis].min(), triangle[:, axis].max())
        begin = depth + behind * BEHIND_NUDGE
        first, last = sorted((np.floor(begin), np.floor(begin + behind * thickness)))
        for voxel in range(int(first), int(last) + 1):
            if not 0 <= voxel - lowest[axis] < level.resolution:
                continue
            place = np.zeros(3, int)
            place[axis] = voxel
            place[u] = lowest[u] + cell_u // cells
            place[v] = lowest[v] + cell_v // cells
            x, y, z = place % level.resolution
            covered[slot, z, y, x, cell_v % cells, cell_u % cells] = True


def _is_inside(
    corner_u: np.ndarray, corner_v: np.ndarray, u: np.ndarray, v: np.ndarray, tolerance: float
) -> np.ndarray:
    """Whether points lie inside a triangle, or less than the tolerance (in voxels) outside."""
    inside = np.ones(u.shape, bool)
    for corner in range(3):
        a, b, opposite = corner, (corner + 1) % 3, (corner + 2) % 3
        along_u, along_v = corner_u[b] - corner_u[a], corner_v[b] - corner_v[a]
        length = np.hypot(along_u, along_v)
        if length == 0.0:
            return np.zeros(u.shape, bool)
        across_u, across_v = -along_v / length, along_u / length
        height = across_u * (corner_u[opposite] - corner_u[a]) + across_v * (
            corner_v[opposite] - corner_v[a]
        )
        if height == 0.0:
            return np.zeros(u.shape, bool)
        distance = across_u * (u - corner_u[a]) + across_v * (v - corner_v[a])
        inside &= np.sign(height) * distance >= -tolerance
    return inside
