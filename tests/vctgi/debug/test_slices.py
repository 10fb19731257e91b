"""Blocks for slices: the order of the world, the larger slot, and merged voxels."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vctgi.debug.straight_rays import VOXEL, one_level, voxels_with
from vctgi.debug.slices import voxel_block

pytestmark = pytest.mark.usefixtures("variant")


@pytest.mark.parametrize("shift", [0, 3, -5])
def test_a_block_is_in_the_order_of_the_world(shift: int) -> None:
    layout = one_level((shift * VOXEL,) * 3)
    level = layout.levels[0]
    x, y, z = (lowest + step for lowest, step in zip(level.origin, (1, 2, 5), strict=True))
    voxels = voxels_with(layout, [((x, y, z), 3, 0.5, [2.0, 1.0, 0.5])])
    block = voxel_block(voxels)
    assert np.argwhere(block.opacity).tolist() == [[5, 2, 1, 1]], "slot 3 belongs to axis y"
    assert block.opacity[5, 2, 1, 1] == 0.5
    np.testing.assert_allclose(block.radiance[5, 2, 1], [2.0, 1.0, 0.5])
    assert np.count_nonzero(block.radiance) == 3
    assert block.pooled == 1


def test_the_larger_of_two_opposite_slots_is_shown() -> None:
    layout = one_level()
    filled = [((0, 0, 0), 4, 0.25, [1.0] * 3), ((0, 0, 0), 5, 0.75, [3.0] * 3)]
    block = voxel_block(voxels_with(layout, filled))
    assert block.opacity[4, 4, 4].tolist() == [0.0, 0.0, 0.75]
    # Radiance is the mean, weighted by opacity.
    np.testing.assert_allclose(block.radiance[4, 4, 4], 0.25 * 1.0 + 0.75 * 3.0)


def test_merged_voxels_keep_thin_walls_and_mean_radiance() -> None:
    layout = one_level()
    filled = [((0, 0, 0), 0, 1.0, [1.0] * 3), ((1, 1, 1), 0, 0.5, [4.0] * 3)]
    block = voxel_block(voxels_with(layout, filled)).merged(2)
    assert block.pooled == 2
    assert block.opacity.shape == (4, 4, 4, 3)
    assert block.opacity[2, 2, 2].tolist() == [1.0, 0.0, 0.0]
    np.testing.assert_allclose(block.radiance[2, 2, 2], (1.0 + 0.5 * 4.0) / 1.5)
    assert np.count_nonzero(block.opacity) == 1


def test_merging_one_voxel_changes_nothing() -> None:
    block = voxel_block(voxels_with(one_level(), [((0, 0, 0), 0, 1.0, [1.0] * 3)]))
    assert block.merged(1) is block
    again = block.merged(2).merged(2)
    np.testing.assert_array_equal(again.opacity, block.merged(4).opacity)
