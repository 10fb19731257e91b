"""Sequences are even and exact, axes are cyclic, faced normals keep to their side."""

from __future__ import annotations

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.evenness import COUNT, deviation
from vctgi.maths.directions import (
    face_forward,
    kronecker_points,
    kronecker_points_4d,
    other_axes,
    unit_from_bits,
)

pytestmark = pytest.mark.usefixtures("variant")


def test_kronecker_points_are_more_even_than_random_ones() -> None:
    points = np.array(kronecker_points(dr.arange(mi.UInt32, COUNT)), np.float64)
    assert points.min() >= 0.0
    assert points.max() < 1.0
    # Even counts lie far below what chance would give.
    assert deviation(list(points), 64) < -20.0


def test_four_coordinates_are_more_even_than_random_ones_together_and_in_pairs() -> None:
    points = [np.array(x, np.float64) for x in kronecker_points_4d(dr.arange(mi.UInt32, COUNT))]
    assert deviation(points, 16) < -20.0
    for first, second in itertools.combinations(points, 2):
        assert deviation([first, second], 64) < -20.0


def test_kronecker_points_stay_exact_at_any_index() -> None:
    near = np.array(kronecker_points(mi.UInt32([0, 1, 2])), np.float64)
    far = np.array(kronecker_points(mi.UInt32([2**31, 2**31 + 1, 2**31 + 2])), np.float64)
    steps = [np.diff(each, axis=1) % 1.0 for each in (near, far)]
    np.testing.assert_allclose(steps[0], steps[1], atol=2.0**-23)


def test_first_kronecker_point_is_the_middle() -> None:
    np.testing.assert_array_equal(np.array(kronecker_points(mi.UInt32(0))).ravel(), 0.5)


def test_unit_numbers_never_reach_one() -> None:
    assert float(unit_from_bits(mi.UInt32(2**32 - 1))[0]) == 1.0 - 2.0**-24
    assert float(unit_from_bits(mi.UInt32(0))[0]) == 0.0


def test_other_axes_are_cyclic() -> None:
    assert [other_axes(axis) for axis in range(3)] == [(1, 2), (2, 0), (0, 1)]


def test_faced_normal_lies_in_the_hemisphere() -> None:
    rng = np.random.default_rng(1)
    n, d = (mi.Vector3f(rng.normal(size=(3, 100)).astype(np.float32)) for _ in range(2))
    faced = face_forward(n, d)
    assert dr.all(dr.dot(faced, d) >= 0.0)
    assert dr.all((faced.x == n.x) | (faced.x == -n.x))
