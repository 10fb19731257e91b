"""Every cone of every point has one lane, and those who ask for it find it."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import vctgi
from experiments.scenes import load_scene
from vctgi.stages.cone_tracing import lane_order
from vctgi.stages.cone_tracing.lane_order import LaneOrder, cone_after_cone

pytestmark = pytest.mark.usefixtures("variant")


@pytest.mark.parametrize("points", [1, 3, 4, 5, 8, 103])
@pytest.mark.parametrize("cones", [1, 6, 17])
@pytest.mark.parametrize("block", [1, 4, 256])
def test_each_cone_has_one_lane(points: int, cones: int, block: int) -> None:
    order = LaneOrder(cones, block)
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


@pytest.mark.parametrize("preset", ["medium", "high", "ambient"])
def test_no_order_changes_a_bit(preset: str, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = load_scene("cornell_box", resolution=(23, 17))
    config = vctgi.preset(preset)
    clipmap = replace(config.clipmap, resolution=16)
    config = replace(config, samples_per_pixel=1, clipmap=clipmap)
    prepared = vctgi.prepare_scene(loaded.scene, loaded.scene.sensors()[0], config)
    volume = vctgi.light_volume(prepared, config).volume
    found = []
    for block in (1, 4, 256):
        monkeypatch.setattr(lane_order, "BLOCK", block)
        monkeypatch.setattr(lane_order, "LONG_BLOCK", block)
        frame = vctgi.render_frame(prepared, volume, config, seed=1)
        image = frame.indirect_diffuse if frame.ambient is None else frame.ambient
        found.append(np.array(image))
    assert found[0].any()
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])


def test_a_table_is_in_order() -> None:
    dealt = cone_after_cone(3, 2).deal(3)
    np.testing.assert_array_equal(np.array(dealt.point), [0, 1, 2, 0, 1, 2])
    np.testing.assert_array_equal(np.array(dealt.cone), [0, 0, 0, 1, 1, 1])
