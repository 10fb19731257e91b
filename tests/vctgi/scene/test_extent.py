"""Bounds of a scene, also where Mitsuba has none for a mesh that it merged."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import load, room
from vctgi.scene.extent import half_extent, scene_bounds

pytestmark = pytest.mark.usefixtures("variant")


def test_merged_walls_have_the_bounds_of_their_room() -> None:
    low, high = scene_bounds(load(**room()))
    np.testing.assert_allclose([low, high], [[-1.0] * 3, [1.0] * 3], atol=1e-6)
    assert float(half_extent(load(**room()))[0]) == pytest.approx(1.0)


def test_curved_shapes_have_their_own_bounds() -> None:
    moved = mi.ScalarTransform4f().translate([5, 0, 0])
    scene = load(ball={"type": "sphere"}, disk={"type": "disk", "to_world": moved})
    low, high = scene_bounds(scene)
    np.testing.assert_allclose([low, high], [[-1, -1, -1], [6, 1, 1]], atol=1e-5)


def test_what_is_not_shown_does_not_count() -> None:
    whole = load(**room(mi.ScalarTransform4f().scale(1e6)))
    assert float(half_extent(whole, 3.0)[0]) == pytest.approx(1.5)
    assert float(half_extent(load(**room()), 3.0)[0]) == pytest.approx(1.0)
