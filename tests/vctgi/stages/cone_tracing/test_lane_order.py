"""Every cone of every point has one lane, and those who ask for it find it."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from vctgi.stages.cone_tracing.lane_order import LaneOrder, cone_after_cone

pytestmark = pytest.mark.usefixtures("variant")


@pytest.mark.parametrize("points", [1, 3, 4, 5, 8, 103])
@pytest.mark.parametrize("cones", [1, 6, 17])
@pytest.mark.parametrize("near_field_voxels", [0.0, 2.0])
def test_each_cone_has_one_lane(points: int, cones: int, near_field_voxels: float) -> None:
    order = LaneOrder.of(cones, near_field_voxels)
    dealt = order.deal(points)
    used = np.broadcast_to(np.array(dealt.is_used), dr.width(dealt.point))
    pairs = np.stack([np.array(dealt.point), np.array(dealt.cone)])
    assert pairs[0].max() < points
    assert pairs[1].max() < cones
    assert len(np.unique(pairs[:, used], axis=1).T) == used.sum() == points * cones
    assert dr.width(dealt.point) < (points + order.block) * cones
    for cone in range(cones):
        lane = np.array(order.lane_of(dr.arange(mi.UInt32, points), cone))
        np.testing.assert_array_equal(pairs[0, lane], np.arange(points))
        np.testing.assert_array_equal(pairs[1, lane], cone)
        assert used[lane].all()


def test_a_table_is_in_order() -> None:
    dealt = cone_after_cone(3, 2).deal(3)
    np.testing.assert_array_equal(np.array(dealt.point), [0, 1, 2, 0, 1, 2])
    np.testing.assert_array_equal(np.array(dealt.cone), [0, 0, 0, 1, 1, 1])
