"""Window boxes and the level that a cone reads, for a camera whose view of them is known."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.debug.straight_rays import VOXEL, rays_of
from tests.vctgi.small_scenes import load
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.debug.boundaries import NO_LEVEL, view_boundaries, window_edge_distance

pytestmark = pytest.mark.usefixtures("variant")


HALF_PIXEL_SIDEWAYS = 0.005
"""What half a pixel of 0.1, seen at a slope of 2 in 40, changes in a distance, with a margin."""


def two_levels() -> ClipmapLayout:
    """Windows from -2 to 2 and from -4 to 4."""
    return lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=VOXEL, level_count=2, resolution=8)


def eye_rays(targets: np.ndarray, eye: tuple[float, float, float]) -> np.ndarray:
    rays: np.ndarray = targets - np.array(eye)
    return rays


def test_a_window_is_seen_at_its_edges_from_outside() -> None:
    level = two_levels().levels[0]
    eye = (0.0, 0.0, -42.0)
    # A pixel is a tenth wide on the near face, which is 40 away.
    steps = (np.arange(60) + 0.5) / 10.0 - 3.0
    x, y = np.meshgrid(steps, steps)
    targets = np.stack([x, y, np.full_like(x, -2.0)], axis=-1)
    rays = rays_of(np.broadcast_to(eye, targets.shape), eye_rays(targets, eye))
    distance = window_edge_distance(level, rays)
    is_line = np.isfinite(distance)
    largest = np.maximum(np.abs(x), np.abs(y))
    on_near_edge = np.abs(largest - 2.0) < 0.06
    assert is_line[on_near_edge & (largest < 2.0)].all()
    assert not is_line[largest > 2.1].any(), "nothing of the window is there"
    # The far face is 44 away, so its edges are seen at 2 * 40 / 44.
    on_far_edge = np.abs(largest - 2.0 * 40.0 / 44.0) < 0.04
    assert on_far_edge.any()
    assert is_line[on_far_edge].all()
    assert not is_line[largest < 1.6].any()
    is_near = on_near_edge & (largest < 2.0)
    straight = np.linalg.norm(targets - eye, axis=-1)
    np.testing.assert_allclose(distance[is_near], straight[is_near], atol=HALF_PIXEL_SIDEWAYS)


def test_from_inside_only_the_far_edges_are_seen() -> None:
    level = two_levels().levels[0]
    steps = (np.arange(50) + 0.5) / 10.0 - 2.5
    x, y = np.meshgrid(steps, steps)
    targets = np.stack([x, y, np.full_like(x, 2.0)], axis=-1)
    rays = rays_of(np.zeros_like(targets), targets)
    distance = window_edge_distance(level, rays)
    largest = np.maximum(np.abs(x), np.abs(y))
    is_line = np.isfinite(distance)
    assert is_line[np.abs(largest - 2.0) < 0.06].all()
    assert not is_line[largest < 1.6].any()


def test_a_surface_tells_the_level_read_there_and_hides_edges() -> None:
    # A sheet at z = 3, outside the finer window and inside the coarser one.
    sheet = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0, 3]).scale([1.0, 1.0, 1.0]),
    }
    floor = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0.5, 0, 0]).scale([0.25, 0.25, 1.0]),
    }
    scene = load(sheet=sheet, floor=floor)
    x = [0.0, 0.5, 0.9, 1.5]
    origins = np.array([[[each, 0.0, -9.0] for each in x], [[each, 0.1, -9.0] for each in x]])
    directions = np.broadcast_to([0.0, 0.0, 1.0], origins.shape)
    seen = view_boundaries(scene, two_levels(), rays_of(origins, directions))
    np.testing.assert_array_equal(seen.is_hit[0], [True, True, True, False])
    # Near the centre the finest level is read; at distance 3 from it the next one.
    np.testing.assert_array_equal(seen.read_level[0], [1.0, 0.0, 1.0, 0.0])
    np.testing.assert_allclose(seen.cosine[0], [1.0, 1.0, 1.0, 0.0], atol=1e-6)
    assert (seen.line_level == NO_LEVEL).all(), "parallel rays have pixels of no width"


def test_a_clipmap_of_one_level_is_read_at_that_level_everywhere() -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=VOXEL, level_count=1, resolution=8)
    origins = np.array([[[0.0, 0.0, -9.0], [0.5, 0.0, -9.0]]])
    rays = rays_of(origins, np.broadcast_to([0.0, 0.0, 1.0], origins.shape))
    seen = view_boundaries(load(sheet={"type": "rectangle"}), layout, rays)
    assert seen.is_hit.all()
    assert seen.read_level.tolist() == [[0.0, 0.0]]
