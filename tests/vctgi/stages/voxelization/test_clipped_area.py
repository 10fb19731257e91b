"""The closed form of a clipped triangle's area equals cutting it plane by plane."""

from __future__ import annotations

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.vctgi.twins.clipping import area
from tests.vctgi.twins.clipping import clipped_area as twin_area
from vctgi.stages.voxelization.clipped_area import clipped_area

pytestmark = pytest.mark.usefixtures("variant")

ROUNDING = 2.0**-44
"""Share of the box that either method may lose to rounding, the twin at each of its six cuts."""

FAR_ROUNDING = 2.0**-49
"""Of a corner's distance in boxes: what the place where an edge passes is rounded to, twice."""

UNIT = np.stack([np.zeros(3), np.ones(3)])

# Corners up to a box outside: on the planes of the box, on a fine grid, or anywhere.
_COORDINATE = st.one_of(
    st.sampled_from([-1.0, 0.0, 0.5, 1.0, 2.0]),
    st.integers(-8, 16).map(lambda i: i / 8.0),
    st.floats(-1.0, 2.0, width=32),
)
_TRIANGLE = arrays(np.float64, (3, 3), elements=_COORDINATE)


def areas(triangles: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Areas of triangles [n or 1, corner, axis] in boxes [n, (low, high), axis]."""
    t, b = np.broadcast_to(triangles, (len(boxes), 3, 3)), boxes
    corner = [[mi.Float64(t[:, c, axis].copy()) for c in range(3)] for axis in range(3)]
    low, high = ([mi.Float64(b[:, end, axis].copy()) for axis in range(3)] for end in range(2))
    found = clipped_area(
        corner[0], corner[1], corner[2], (low[0], low[1], low[2]), (high[0], high[1], high[2])
    )
    values: np.ndarray = np.array(found)
    return values


def in_box(triangle: list[list[float]] | np.ndarray, box: np.ndarray = UNIT) -> float:
    return float(areas(np.array(triangle, float)[None], box[None])[0])


def partition(counts: tuple[int, int, int], low: float, high: float) -> np.ndarray:
    """Boxes [box, (low, high), axis] that fill the cube [low, high]^3."""
    edges = [np.linspace(low, high, count + 1) for count in counts]
    places = itertools.product(*(range(count) for count in counts))
    return np.array(
        [
            [
                [edges[a][place[a]] for a in range(3)],
                [edges[a][place[a] + 1] for a in range(3)],
            ]
            for place in places
        ]
    )


@settings(max_examples=100)
@given(triangle=_TRIANGLE)
def test_equals_the_twin(triangle: np.ndarray) -> None:
    boxes = partition((2, 2, 3), -0.5, 1.5)
    expected = [twin_area(triangle, *box) for box in boxes]
    found = areas(triangle[None], boxes)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING)


@settings(max_examples=40)
@given(triangle=_TRIANGLE, counts=st.tuples(*[st.integers(1, 5)] * 3))
def test_boxes_that_fill_space_hold_the_whole_area(
    triangle: np.ndarray, counts: tuple[int, int, int]
) -> None:
    boxes = partition(counts, -1.0, 2.0 + 2.0**-20)
    found = areas(triangle[None], boxes).sum()
    assert found == pytest.approx(area(triangle), rel=0.0, abs=ROUNDING * len(boxes))


@settings(max_examples=40)
@given(triangle=_TRIANGLE, order=st.permutations(range(3)))
def test_neither_winding_nor_first_corner_matter(triangle: np.ndarray, order: list[int]) -> None:
    assert in_box(triangle[order]) == pytest.approx(in_box(triangle), rel=0.0, abs=ROUNDING)


@settings(max_examples=40)
@given(triangle=_TRIANGLE)
def test_a_mirrored_or_turned_picture_has_the_same_area(triangle: np.ndarray) -> None:
    same = in_box(triangle)
    swapped = in_box(triangle[:, [1, 0, 2]])
    mirrored = in_box(triangle * [-1.0, 1.0, 1.0] + [1.0, 0.0, 0.0])
    assert swapped == pytest.approx(same, rel=0.0, abs=ROUNDING)
    assert mirrored == pytest.approx(same, rel=0.0, abs=ROUNDING)


@settings(max_examples=40)
@given(triangle=_TRIANGLE, exponent=st.integers(-60, 60))
def test_scaling_by_a_power_of_two_is_exact(triangle: np.ndarray, exponent: int) -> None:
    scale = 2.0**exponent
    assert in_box(scale * triangle, scale * UNIT) == scale**2 * in_box(triangle)


SPECIAL = {
    "seen edge-on": ([[0, 0, 0], [1, 1, 1], [0.5, 0.5, 0]], 0.0),
    "a point": ([[0.5, 0.5, 0.5]] * 3, 0.0),
    "edge-on along v": ([[0.5, 0, 0], [0.5, 1, 0], [0.5, 0.5, 1]], 0.0),
    "half of the box": ([[0, 0, 0.5], [1, 0, 0.5], [0, 1, 0.5]], 0.5),
    "covers the box": ([[-9, -9, 0.5], [20, -9, 0.5], [-9, 20, 0.5]], 1.0),
    "on the lower face": ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], 0.5),
    "on the upper face": ([[0, 0, 1], [1, 0, 1], [0, 1, 1]], 0.0),
    "between the depths": ([[0, 0, 0], [1, 0, 1], [0, 1, 0]], 0.5),
    "half above": ([[0, 0, 0], [1, 0, 2], [0, 1, 0]], 0.375),
    "tip below": ([[0, 0, -1], [1, 0, 1], [0, 1, 1]], 0.375),
    "stripe": ([[0, 0, -1], [1, 0, 2], [0, 1, -1]], 1.0 / 6.0),
    "beside the box": ([[1, 0, 0.5], [2, 0, 0.5], [1, 1, 0.5]], 0.0),
    "past a corner of the box": ([[2, 0.5, 0.5], [0.5, 2, 0.5], [2, 2, 0.5]], 0.0),
}


@pytest.mark.parametrize(("triangle", "expected"), SPECIAL.values(), ids=SPECIAL.keys())
def test_special_triangles(triangle: list[list[float]], expected: float) -> None:
    found = in_box(triangle)
    assert found == pytest.approx(expected, rel=0.0, abs=ROUNDING)
    # What is not there must not leave its rounding in empty voxels.
    assert (found == 0.0) == (expected == 0.0)


def test_huge_triangles_are_right_to_the_rounding_of_their_corners() -> None:
    size = 1e6
    rng = np.random.default_rng(1)
    corners = rng.normal(0.0, size, (400, 3, 3))
    # Through the box: the centre of gravity of each lies in it.
    corners += rng.uniform(0.0, 1.0, (400, 1, 3)) - corners.mean(axis=1, keepdims=True)
    found = areas(corners, np.broadcast_to(UNIT, (400, 2, 3)))
    expected = [twin_area(corner, *UNIT) for corner in corners]
    assert np.count_nonzero(expected) > 300
    limit = FAR_ROUNDING * np.abs(corners).max()
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=limit)


@pytest.mark.parametrize("size", [1e-3, 1e-8, 1e-12])
def test_tiny_triangles_keep_their_digits(size: float) -> None:
    rng = np.random.default_rng(2)
    corners = 0.5 + size * rng.uniform(-1.0, 1.0, (100, 3, 3))
    found = areas(corners, np.broadcast_to(UNIT, (100, 2, 3)))
    expected = [area(corner) for corner in corners]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING * size**2)


def test_far_from_the_origin_nothing_changes() -> None:
    rng = np.random.default_rng(3)
    # Multiples of 2^-20 stay exact when 2^17 is added.
    corners = np.round(rng.uniform(-1.0, 2.0, (100, 3, 3)) * 2.0**20) / 2.0**20
    boxes = np.broadcast_to(UNIT, (100, 2, 3))
    near, far = areas(corners, boxes), areas(corners + 2.0**17, boxes + 2.0**17)
    np.testing.assert_allclose(far, near, rtol=0.0, atol=ROUNDING)


GRADIENT_NOISE = 1e-6
"""Of the largest derivative: what cancelling terms leave on CUDA, where derivatives of quotients
take a reciprocal of single precision's accuracy (measured: up to 3e-7)."""


def gradient(triangle: np.ndarray) -> np.ndarray:
    """Return the derivatives [corner, axis] of the area in the unit box."""
    # Opaque, or selections would be decided before the derivative is taken.
    corner = [[dr.opaque(mi.Float64, triangle[c, axis]) for c in range(3)] for axis in range(3)]
    dr.enable_grad(corner)
    zero, one = mi.Float64(0.0), mi.Float64(1.0)
    found = clipped_area(corner[0], corner[1], corner[2], (zero, zero, zero), (one, one, one))
    dr.backward(found)
    return np.array([[float(dr.grad(corner[a][c])[0]) for a in range(3)] for c in range(3)])


@pytest.mark.parametrize("triangle", [t for t, _ in SPECIAL.values()], ids=SPECIAL.keys())
def test_derivatives_are_finite_everywhere(triangle: list[list[float]]) -> None:
    assert np.isfinite(gradient(np.array(triangle, float))).all()


@pytest.mark.parametrize("span", [1e-300, 1e-149, 1e-30, 1e-9])
def test_derivatives_of_nearly_degenerate_triangles_are_finite(span: float) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, span, span], [0.5, -span, 1.0 - span]])
    for axes in itertools.permutations(range(3)):
        assert np.isfinite(gradient(corners[:, axes])).all()


def test_derivatives_equal_differences() -> None:
    rng = np.random.default_rng(4)
    step = 1e-6
    for _ in range(10):
        triangle = rng.uniform(-0.5, 1.5, (3, 3))
        moved = np.repeat(triangle[None], 18, axis=0)
        for number, (c, axis, sign) in enumerate(
            itertools.product(range(3), range(3), (1.0, -1.0))
        ):
            moved[number, c, axis] += sign * step
        values = areas(moved, np.broadcast_to(UNIT, (18, 2, 3))).reshape(3, 3, 2)
        differences = (values[..., 0] - values[..., 1]) / (2.0 * step)
        # Central differences of a piecewise smooth function: second order in the step, and the
        # rounding of the areas over it.
        found = gradient(triangle)
        atol = 1e-8 + GRADIENT_NOISE * np.abs(found).max()
        np.testing.assert_allclose(found, differences, rtol=1e-5, atol=atol)


def test_edges_along_an_axis_have_the_derivative_of_either_side() -> None:
    # Moving the left edge by its two ends changes base times height over two.
    triangle = np.array([[0.2, 0.2, 0.5], [0.8, 0.2, 0.5], [0.2, 0.8, 0.5]])
    found = gradient(triangle)
    assert found[0, 0] + found[2, 0] == pytest.approx(-0.3, abs=1e-12)
    assert found[0, 1] + found[1, 1] == pytest.approx(-0.3, abs=1e-12)
