"""Two opacities compared: nothing apart is nothing; known differences come out as they are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vctgi.debug.straight_rays import rays_through_columns
from tests.vctgi.hand_made_volumes import opacity_of, random_values
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.debug.opacity_difference import compare_opacity, difference_numbers

pytestmark = pytest.mark.usefixtures("variant")


def two_levels() -> ClipmapLayout:
    return lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=2, resolution=8)


def test_an_opacity_does_not_differ_from_itself() -> None:
    layout = two_levels()
    opacity = opacity_of(layout, random_values(layout, seed=1)[0])
    rays = rays_through_columns(layout.levels[1])
    found = compare_opacity(opacity, opacity, 1, rays)
    assert found.is_hit.any()
    assert not found.difference.any()
    numbers = found.numbers
    assert (numbers.mean, numbers.rms, numbers.largest, numbers.total_ratio) == (0.0, 0.0, 0.0, 1.0)
    assert numbers.slot_count == np.count_nonzero(np.array(opacity.levels[1]))


def test_a_known_difference_is_shown_with_its_sign() -> None:
    layout = two_levels()
    first, second = (
        [np.zeros((6,) + (each.resolution,) * 3) for each in layout.levels] for _ in range(2)
    )
    first[1][4] = 0.25
    second[1][4] = 0.75
    rays = rays_through_columns(layout.levels[1])
    found = compare_opacity(opacity_of(layout, first), opacity_of(layout, second), 1, rays)
    np.testing.assert_array_equal(found.difference, np.full((8, 8), -0.5))
    numbers = found.numbers
    assert (numbers.slot_count, numbers.mean, numbers.rms) == (8**3, -0.5, 0.5)
    assert numbers.largest == 0.5
    assert numbers.total_ratio == pytest.approx(1.0 / 3.0)


def test_a_voxel_that_only_one_of_them_has_is_shown() -> None:
    layout = two_levels()
    first, second = (
        [np.zeros((6,) + (each.resolution,) * 3) for each in layout.levels] for _ in range(2)
    )
    second[0][4, 0, 3, 2] = 1.0
    rays = rays_through_columns(layout.levels[0])
    found = compare_opacity(opacity_of(layout, first), opacity_of(layout, second), 0, rays)
    assert found.is_hit.sum() == 1
    assert found.difference.min() == -1.0
    assert found.numbers.total_ratio == 0.0


def test_only_voxels_with_children_are_compared_within_the_finer_window() -> None:
    layout = two_levels()
    first, second = (
        [np.zeros((6,) + (each.resolution,) * 3) for each in layout.levels] for _ in range(2)
    )
    first[1][:] = 1.0
    rays = rays_through_columns(layout.levels[1])
    found = compare_opacity(
        opacity_of(layout, first), opacity_of(layout, second), 1, rays, layout.levels[0]
    )
    expected = np.zeros((8, 8))
    expected[2:6, 2:6] = 1.0
    np.testing.assert_array_equal(found.difference, expected)
    assert found.numbers.slot_count == 6 * 4**3
    assert found.numbers.total_ratio is None


def test_nothing_against_nothing_has_numbers_too() -> None:
    numbers = difference_numbers(np.zeros(4), np.zeros(4))
    assert (numbers.slot_count, numbers.mean, numbers.rms, numbers.largest) == (0, 0.0, 0.0, 0.0)
    assert numbers.total_ratio is None
