"""Rays through voxels: they see what is stored, from its front, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vctgi.debug.straight_rays import (
    VOXEL,
    one_level,
    rays_of,
    rays_through_columns,
    voxels_with,
)
from vctgi.debug.ray_cast import compose_voxels, first_voxels

pytestmark = pytest.mark.usefixtures("variant")

ROUNDING = 1e-6
"""Single precision, for numbers of order 1 that a few operations made."""

TOWARDS_UPPER, TOWARDS_LOWER = 4, 5
"""Slots of axis z: what rays travelling towards +z and -z meet."""

RED, GREEN = [2.0, 0.5, 0.25], [0.25, 1.0, 0.5]


def test_a_slot_is_seen_from_its_front_only() -> None:
    layout = one_level()
    voxels = voxels_with(layout, [((0, 1, 2), TOWARDS_UPPER, 1.0, RED)])
    seen = first_voxels(voxels, rays := rays_through_columns(layout.levels[0]))
    expected = np.zeros((8, 8), bool)
    expected[1 + 4, 0 + 4] = True
    np.testing.assert_array_equal(rays.picture(seen.is_hit), expected)
    behind = rays_through_columns(layout.levels[0], towards=-1)
    assert not np.array(first_voxels(voxels, behind).is_hit).any()


@pytest.mark.parametrize("shift", [0, 1, -3, 40_000])
def test_the_depth_is_where_the_ray_enters_the_voxel_wherever_the_window_lies(shift: int) -> None:
    layout = one_level((shift * VOXEL, 0.0, shift * VOXEL))
    voxels = voxels_with(layout, [((shift, 1, shift + 2), TOWARDS_UPPER, 1.0, RED)])
    rays = rays_through_columns(layout.levels[0])
    hits = first_voxels(voxels, rays)
    hit = np.array(hits.is_hit)
    assert hit.sum() == 1
    start = layout.levels[0].window_min[2] - 1.0
    depth = np.array(hits.depth)
    # Coordinates of 20000 leave a 500th of a voxel.
    assert depth[hit][0] == pytest.approx((shift + 2) * VOXEL - start, abs=1e-3)
    assert not depth[~hit].any()


def test_the_nearest_of_two_voxels_is_seen() -> None:
    layout = one_level()
    filled = [((0, 0, z), TOWARDS_UPPER, 1.0, RED) for z in (3, -1)]
    rays = rays_through_columns(layout.levels[0])
    depth = np.array(first_voxels(voxels_with(layout, filled), rays).depth)
    assert depth.max() == pytest.approx(1.0 + 3 * VOXEL)


def test_what_is_too_thin_is_looked_through() -> None:
    layout = one_level()
    filled = [
        ((0, 0, -1), TOWARDS_UPPER, 0.25, RED),
        ((0, 0, 1), TOWARDS_UPPER, 0.75, RED),
    ]
    rays = rays_through_columns(layout.levels[0])
    voxels = voxels_with(layout, filled)
    for threshold, z in ((0.25, -1), (0.5, 1)):
        depth = np.array(first_voxels(voxels, rays, threshold).depth)
        assert depth.max() == pytest.approx(1.0 + (4 + z) * VOXEL)
    assert not np.array(first_voxels(voxels, rays, 1.0).is_hit).any()


@pytest.mark.parametrize("threshold", [0.0, -1.0, 1.5, float("nan")])
def test_a_threshold_that_tells_nothing_apart_is_refused(threshold: float) -> None:
    layout = one_level()
    with pytest.raises(ValueError, match=r"threshold must be in \(0, 1\]"):
        first_voxels(voxels_with(layout, []), rays_through_columns(layout.levels[0]), threshold)


def test_an_empty_level_shows_nothing() -> None:
    layout = one_level()
    rays = rays_through_columns(layout.levels[0])
    voxels = voxels_with(layout, [])
    assert not np.array(first_voxels(voxels, rays).is_hit).any()
    radiance, opacity = compose_voxels(voxels, rays)
    assert not np.array(radiance).any()
    assert not np.array(opacity).any()


def test_the_voxel_around_the_camera_is_not_seen_and_the_next_one_is() -> None:
    layout = one_level()
    filled = [((0, 0, z), TOWARDS_UPPER, 1.0, RED) for z in (0, 1)]
    origin = np.full((1, 1, 3), 0.5 * VOXEL)
    rays = rays_of(origin, np.array([[[0.0, 0.0, 1.0]]]))
    assert np.array(first_voxels(voxels_with(layout, filled), rays).depth)[0] == 0.5 * VOXEL
    alone = voxels_with(layout, filled[:1])
    assert not np.array(first_voxels(alone, rays).is_hit).any()


def test_rays_past_the_window_and_along_its_faces_end() -> None:
    layout = one_level()
    voxels = voxels_with(layout, [((0, 0, 0), TOWARDS_UPPER, 1.0, RED)])
    origins = np.array([[[9.0, 9.0, -9.0], [2.0, 2.0, -9.0], [0.0, 0.0, 9.0], [0.25, 0.25, 9.0]]])
    directions = np.array([[[0, 0, 1.0], [0, 0, 1.0], [0, 0, 1.0], [1.0, 0, 0]]])
    assert not np.array(first_voxels(voxels, rays_of(origins, directions)).is_hit).any()


def test_layers_compose_front_to_back() -> None:
    layout = one_level()
    filled = [
        ((0, 0, -1), TOWARDS_UPPER, 0.25, RED),
        ((0, 0, 2), TOWARDS_UPPER, 0.5, GREEN),
    ]
    rays = rays_through_columns(layout.levels[0])
    radiance, opacity = compose_voxels(voxels_with(layout, filled), rays)
    expected = 0.25 * np.array(RED) + 0.75 * 0.5 * np.array(GREEN)
    np.testing.assert_allclose(rays.picture(radiance)[4, 4], expected, rtol=ROUNDING)
    assert rays.picture(opacity)[4, 4] == pytest.approx(1.0 - 0.75 * 0.5, rel=ROUNDING)
    assert rays.picture(opacity).astype(bool).sum() == 1


def test_a_layer_stops_the_same_share_of_light_at_any_angle() -> None:
    layout = one_level()
    layer = [((x, y, 0), TOWARDS_UPPER, 0.75, RED) for x in range(-4, 4) for y in range(-4, 4)]
    slopes = np.linspace(-0.8, 0.8, 9)
    directions = np.stack([slopes, 0.5 * slopes, np.ones(9)], axis=-1)[None]
    rays = rays_of(np.full((1, 9, 3), -0.03), directions)
    radiance, opacity = compose_voxels(voxels_with(layout, layer), rays)
    # Length of the path within the layer times the cosine is one voxel.
    np.testing.assert_allclose(np.array(opacity), 0.75, rtol=ROUNDING)
    np.testing.assert_allclose(rays.picture(radiance)[0], 0.75 * np.tile(RED, (9, 1)), rtol=1e-5)
    from_behind = rays_of(np.full((1, 9, 3), 0.6), -directions)
    _, opacity = compose_voxels(voxels_with(layout, layer), from_behind)
    assert not np.array(opacity).any(), "slots are one-sided"
    assert TOWARDS_LOWER == TOWARDS_UPPER + 1
