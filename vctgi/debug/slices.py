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
    weight
        [z, y, x] sum of the opacity of all slots, which the radiance is the mean over.
    """

    level: LevelLayout
    pooled: int
    opacity: np.ndarray
    radiance: np.ndarray
    weight: np.ndarray

    def merged(self, count: int) -> VoxelBlock:
        """Return the block with `count`^3 voxels merged into one."""
        if count == 1:
            return self
        emitted = self.radiance * self.weight[..., None]
        weight = _pool(self.weight, count, np.sum)
        return VoxelBlock(
            level=self.level,
            pooled=self.pooled * count,
            opacity=_by_channel(self.opacity, count, np.max),
            radiance=_over(_by_channel(emitted, count, np.sum), weight),
            weight=weight,
        )


def voxel_block(voxels: LevelVoxels) -> VoxelBlock:
    """Return a level as a block."""
    level = voxels.level
    shape = (DIRECTION_COUNT, *(level.resolution,) * 3)
    slots = _in_order(np.array(voxels.opacity).reshape(shape), level)
    weight = slots.sum(axis=0)
    opacity = np.stack([slots[2 * axis : 2 * axis + 2].max(axis=0) for axis in range(3)], axis=-1)
    emitted = [
        _in_order(np.array(channel).reshape(shape), level).sum(axis=0)
        for channel in voxels.emittance
    ]
    return VoxelBlock(level, 1, opacity, _over(np.stack(emitted, axis=-1), weight), weight)


def _over(emitted: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Emittance over opacity, 0 where there is none."""
    radiance: np.ndarray = emitted / np.where(weight > 0.0, weight, 1.0)[..., None]
    return radiance


def _by_channel(values: np.ndarray, count: int, merge: Callable[..., np.ndarray]) -> np.ndarray:
    """Merge blocks of `count`^3 values of [z, y, x, channel]."""
    merged = [_pool(values[..., channel], count, merge) for channel in range(values.shape[-1])]
    return np.stack(merged, axis=-1)


def _in_order(values: np.ndarray, level: LevelLayout) -> np.ndarray:
    """Undo the toroidal addressing of [direction, z, y, x]."""
    x, y, z = (-(lowest % level.resolution) for lowest in level.origin)
    return np.roll(values, (z, y, x), axis=(1, 2, 3))


def _pool(values: np.ndarray, count: int, merge: Callable[..., np.ndarray]) -> np.ndarray:
    """Merge blocks of `count`^3 values of [z, y, x]."""
    edge = values.shape[0] // count
    blocks = values.reshape(edge, count, edge, count, edge, count)
    return merge(blocks, axis=(1, 3, 5))
