"""Opacity voxelization by samples, one after the other: the definition, with no care for speed."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import BEHIND_NUDGE, SlotRule
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.voxelization.columns import EDGE_TOLERANCE
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig
from vctgi.stages.voxelization.triangles import unit_normals

SIXTEENTHS = ((1, -3), (-1, 3), (5, 1), (-3, -5), (-5, 5), (-7, -1), (3, 7), (7, -7))
"""Samples (u, v) of a face, from its centre."""

BLOCKS = (4, 2)
"""Blocks along u and v of a face; each holds one sample and is 2 x 4 cells large."""


@dataclass
class Grid:
    """Covered cells [slot, z, y, x, cell v, cell u] of a level, at toroidal addresses."""

    level: LevelLayout
    cells: int
    covered: np.ndarray

    def set(self, slot: int, layer: int, cell_u: int, cell_v: int) -> None:
        """Cover a cell of the level's lattice, if the window holds it."""
        axis = slot // 2
        voxel = np.zeros(3, int)
        voxel[axis] = layer
        voxel[(axis + 1) % 3] = cell_u // self.cells
        voxel[(axis + 2) % 3] = cell_v // self.cells
        edge = self.level.resolution
        inside = voxel - np.array(self.level.origin)
        if np.all((inside >= 0) & (inside < edge)):
            x, y, z = voxel % edge
            self.covered[slot, z, y, x, cell_v % self.cells, cell_u % self.cells] = True


def voxelize(
    vertices: np.ndarray, level: LevelLayout, config: OpacityVoxelizationConfig
) -> np.ndarray:
    """Return the opacity [direction, z, y, x] of triangles [triangle, corner, 3]."""
    edge, cells = level.resolution, 8 * config.supersampling(level.level)
    grid = Grid(level, cells, np.zeros((DIRECTION_COUNT, edge, edge, edge, cells, cells), bool))
    for triangle, normal in zip(vertices, unit_normals(vertices), strict=True):
        # The renderer keeps normals in single precision.
        axis = int(np.argmax(np.abs(normal.astype(np.float32))))
        _mark(grid, triangle / level.voxel_size, normal, axis, config.slots)
    if config.is_two_sided:
        grid.covered |= grid.covered[[1, 0, 3, 2, 5, 4]]
    share: np.ndarray = grid.covered.sum(axis=(-1, -2)) / cells**2
    return share


def _mark(grid: Grid, corners: np.ndarray, normal: np.ndarray, axis: int, rule: SlotRule) -> None:
    """Cover what a triangle, in voxels, covers: all its samples on all three axes."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    faces_per_voxel = grid.cells // 8
    margin = math.ceil(rule.thickness_voxels)
    low, high = (
        faces_per_voxel * (np.array(grid.level.origin) + side)
        for side in (-margin, grid.level.resolution + margin)
    )
    first = np.maximum(np.floor(corners.min(axis=0) * faces_per_voxel) - 1, low)
    last = np.minimum(np.floor(corners.max(axis=0) * faces_per_voxel) + 1, high)
    for face_u in range(int(first[u]), int(last[u]) + 1):
        for face_v in range(int(first[v]), int(last[v]) + 1):
            for sample_u, sample_v in SIXTEENTHS:
                sample = np.array([face_u + 0.5 + sample_u / 16.0, face_v + 0.5 + sample_v / 16.0])
                if _holds(corners[:, [u, v]] * grid.cells, sample * 8.0, EDGE_TOLERANCE):
                    _cover(grid, corners, normal, axis, rule, sample / faces_per_voxel)


def _holds(triangle: np.ndarray, point: np.ndarray, tolerance: float) -> bool:
    """Whether a triangle [corner, 2] holds a point, or misses it by less than the tolerance."""
    turn = _cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    if turn == 0.0:
        return False
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        inside = np.sign(turn) * _cross(b - a, point - a) / math.hypot(*(b - a))
        if inside < -tolerance:
            return False
    return True


def _cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _cover(
    grid: Grid,
    corners: np.ndarray,
    normal: np.ndarray,
    axis: int,
    rule: SlotRule,
    sample: np.ndarray,
) -> None:
    """Cover what a sample (u, v), in voxels, stands for."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    size = np.array([8.0 / BLOCKS[0], 8.0 / BLOCKS[1]]) / grid.cells
    centre = (np.floor(sample / size) + 0.5) * size
    slope = -normal[[u, v]] / normal[axis]
    depth = corners[0, axis] + float(np.dot(slope, sample - corners[0, [u, v]]))
    # A sample at the rim may lie outside by the tolerance; its depth does not.
    depth = min(max(depth, corners[:, axis].min()), corners[:, axis].max())
    depth += float(np.dot(slope, centre - sample)) - np.sign(normal[axis]) * BEHIND_NUDGE

    blocks = [
        range(round((middle - 0.5 * edge) * grid.cells), round((middle + 0.5 * edge) * grid.cells))
        for middle, edge in zip(centre, size, strict=True)
    ]
    for layer, cell_u, cell_v in itertools.product(_layers(depth, normal[axis], rule), *blocks):
        grid.set(_slot(axis, normal), layer, cell_u, cell_v)
    for along, lateral in ((0, 1), (1, 0)):
        side = (axis + 1 + along) % 3
        if normal[side] == 0.0:
            continue
        layers = _layers(centre[along] - np.sign(normal[side]) * BEHIND_NUDGE, normal[side], rule)
        half = 0.5 * abs(slope[along]) * size[along]
        for row in blocks[lateral]:
            middle = depth + slope[lateral] * ((row + 0.5) / grid.cells - centre[lateral])
            for cell in _interval(grid.cells * middle, grid.cells * half):
                for layer in layers:
                    face = (row, cell) if along == 0 else (cell, row)
                    grid.set(_slot(side, normal), layer, *face)


def _slot(axis: int, normal: np.ndarray) -> int:
    """Slot of the rays that meet a surface from its front."""
    return 2 * axis + (0 if normal[axis] < 0.0 else 1)


def _layers(begin: float, normal_component: float, rule: SlotRule) -> range:
    """Layers of voxels that a surface fills, from a place already a little behind it."""
    is_sloped = np.float32(abs(normal_component)) < np.float32(rule.sloped_below)
    thickness = rule.thickness_voxels if is_sloped else 0.0
    end = begin - np.sign(normal_component) * thickness
    first, last = sorted((math.floor(begin), math.floor(end)))
    return range(first, last + 1)


def _interval(middle: float, half: float) -> list[int]:
    """Cells whose centres lie in an interval of depths, in cells, or the one of its middle."""
    low, high = middle - half - EDGE_TOLERANCE, middle + half + EDGE_TOLERANCE
    nearby = range(math.floor(low) - 1, math.floor(high) + 2)
    return [cell for cell in nearby if low <= cell + 0.5 <= high] or [math.floor(middle)]
