"""Downsampling, voxel by voxel."""

from __future__ import annotations

import itertools

import numpy as np

from vctgi.clipmap.levels import LevelLayout
from vctgi.maths.directions import other_axes


def window_of(level: LevelLayout) -> itertools.product[tuple[int, ...]]:
    """All voxels (x, y, z) of a level's window."""
    return itertools.product(*(range(o, o + level.resolution) for o in level.origin))


def is_held(voxel: np.ndarray, level: LevelLayout) -> bool:
    """Whether a voxel lies in a level's window."""
    local = voxel - np.array(level.origin)
    return bool(np.all(local >= 0) and np.all(local < level.resolution))


def address(voxel: np.ndarray, level: LevelLayout) -> tuple[int, int, int]:
    """Where a voxel is stored: (z, y, x)."""
    x, y, z = (int(i) % level.resolution for i in voxel)
    return z, y, x


def downsample_level(
    finer: LevelLayout,
    coarser: LevelLayout,
    fine: tuple[np.ndarray, np.ndarray],
    coarse: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Return opacity [direction, z, y, x] and emittance [.., 3] of the coarser level."""
    alpha, color = coarse[0].copy(), coarse[1].copy()
    for voxel in window_of(coarser):
        parent = np.array(voxel)
        if not is_held(2 * parent, finer):
            continue
        for axis in range(3):
            for side in range(2):
                slot = 2 * axis + side
                place = (slot, *address(parent, coarser))
                alpha[place], color[place] = _merge(fine, finer, parent, axis, side)
    return alpha, color


def _merge(
    fine: tuple[np.ndarray, np.ndarray],
    finer: LevelLayout,
    parent: np.ndarray,
    axis: int,
    side: int,
) -> tuple[float, np.ndarray]:
    """Mean of the four columns; in each the back child shows through what the front leaves."""
    u, v = other_axes(axis)
    total_alpha, total_color = 0.0, np.zeros(3)
    for step_u, step_v in itertools.product(range(2), repeat=2):
        children = []
        for along in range(2):
            child = 2 * parent
            child[axis] += along
            child[u] += step_u
            child[v] += step_v
            assert is_held(child, finer), "children must be all inside or all outside"
            children.append((2 * axis + side, *address(child, finer)))
        front, back = children if side == 0 else children[::-1]
        open_share = 1.0 - fine[0][front]
        visible = min(open_share, fine[0][back])
        total_alpha += 0.25 * (fine[0][front] + visible)
        total_color += 0.25 * fine[1][front]
        if fine[0][back] > 0.0:
            total_color += 0.25 * fine[1][back] * (visible / fine[0][back])
    return total_alpha, total_color
