"""The voxels of a level as a block of numbers, to be cut into slices along any axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vctgi.clipmap.levels import LevelLayout
from vctgi.debug.voxels import LevelVoxels
from vctgi.maths.directions import DIRECTION_COUNT


@dataclass
class VoxelBlock:
    """One level in the order of the world: index 0 is the lowest voxel of the window.

    Attributes
    ----------
    level
        Where the level lies.
    pooled
        Voxels along an edge that were merged into one.
    opacity
        [z, y, x, axis] the larger of the two opposite slots of each axis, [0, 1]; of merged voxels
        the largest, so that thin walls stay.
    radiance
        [z, y, x, 3] emittance over opacity, all six slots together, W m^-2 sr^-1.
    """

    level: LevelLayout
    pooled: int
    opacity: np.ndarray
    radiance: np.ndarray


def voxel_block(voxels: LevelVoxels, largest: int | None = None) -> VoxelBlock:
    """Return a level as a block.

    Parameters
    ----------
    voxels
        The level.
    largest
        Most voxels along an edge of the block, a power of two; None for all. More are merged.
    """
    level = voxels.level
    edge = level.resolution
    pooled = 1 if largest is None else max(1, edge // largest)
    opacity = _in_order(np.array(voxels.opacity).reshape(DIRECTION_COUNT, edge, edge, edge), level)
    total = _pool(opacity.sum(axis=0), pooled, np.sum)
    strongest = np.stack(
        [_pool(np.maximum(*opacity[2 * axis : 2 * axis + 2]), pooled, np.max) for axis in range(3)],
        axis=-1,
    )
    emitted = [
        _pool(
            _in_order(np.array(c).reshape(DIRECTION_COUNT, edge, edge, edge), level).sum(axis=0),
            pooled,
            np.sum,
        )
        for c in voxels.emittance
    ]
    radiance = np.stack(emitted, axis=-1) / np.where(total > 0.0, total, 1.0)[..., None]
    return VoxelBlock(level, pooled, strongest, radiance)


def _in_order(values: np.ndarray, level: LevelLayout) -> np.ndarray:
    """Undo the toroidal addressing of [direction, z, y, x]."""
    x, y, z = (-(lowest % level.resolution) for lowest in level.origin)
    return np.roll(values, (z, y, x), axis=(1, 2, 3))


def _pool(values: np.ndarray, count: int, merge: Callable[..., np.ndarray]) -> np.ndarray:
    """Merge blocks of `count`^3 values of [z, y, x]."""
    if count == 1:
        return values
    edge = values.shape[0] // count
    blocks = values.reshape(edge, count, edge, count, edge, count)
    return merge(blocks, axis=(1, 3, 5))
