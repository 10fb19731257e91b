"""Scenes of the studies: their closed forms, and which way their surfaces face."""

from __future__ import annotations

import math

import numpy as np
import pytest

from experiments.studies import scenes
from experiments.studies.check import mean_of
from experiments.studies.phases import phase_offsets, spread_of

ROUNDING = 1e-12

PAIRS_OF_POINTS = 400
"""Points of each square; the mean over all pairs misses the form factor by less than 1 %."""


def test_closed_forms_are_the_tabulated_ones() -> None:
    assert scenes.parallel_form_factor(1.0) == pytest.approx(0.19982, abs=1e-5)
    assert scenes.perpendicular_form_factor() == pytest.approx(0.20004, abs=1e-5)


@pytest.mark.parametrize("distance", [0.25, 1.0])
def test_parallel_squares_are_what_their_form_factor_is_of(distance: float) -> None:
    scene = scenes.parallel_squares(distance, 20, seed=1)
    lit = scenes.FLOOR.stratified_points(20, np.random.default_rng(2))
    assert len(lit) == len(scene.points) == PAIRS_OF_POINTS
    between = scene.points[:, None] - lit[None]
    squared = np.sum(between**2, axis=-1)
    cosine_out = between @ scenes.FLOOR.normal
    cosine_in = -np.einsum("ijk,ik->ij", between, scene.normals)
    assert (cosine_in > 0.0).all()
    kernel = cosine_in * cosine_out / (math.pi * squared**2)
    assert kernel.mean() == pytest.approx(scenes.parallel_form_factor(distance), rel=0.01)


@pytest.mark.parametrize("is_turned", [False, True])
def test_rooms_shine_inwards_and_are_closed(is_turned: bool) -> None:
    scene = scenes.white_furnace(3, seed=1)
    scene = scene.turned() if is_turned else scene
    normal = np.cross(
        scene.triangles[:, 1] - scene.triangles[:, 0], scene.triangles[:, 2] - scene.triangles[:, 0]
    )
    inward = -np.einsum("ij,ij->i", normal, scene.triangles.mean(axis=1))
    assert (inward > 0.0).all()
    # A closed surface's area vectors cancel, and the box is two wide.
    np.testing.assert_allclose(normal.sum(axis=0), 0.0, atol=ROUNDING)
    assert 0.5 * np.linalg.norm(normal, axis=1).sum() == pytest.approx(24.0)
    assert (np.einsum("ij,ij->i", scene.normals, -scene.points) > 0.0).all()


def test_receivers_of_the_divided_rooms_are_dark() -> None:
    scene = scenes.divided_rooms(0.2, 4, seed=1)
    assert scene.points[:, 0].min() >= 0.1
    lit = scene.triangles[scene.radiance > 0.0]
    assert lit[..., 0].max() == pytest.approx(-0.1)


def test_the_oblique_turn_is_a_rotation_about_its_axis() -> None:
    turn = scenes.oblique_matrix()
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=ROUNDING)
    np.testing.assert_allclose(turn @ scenes.OBLIQUE_AXIS, scenes.OBLIQUE_AXIS, atol=ROUNDING)
    assert np.trace(turn) == pytest.approx(1.0 + 2.0 * math.cos(math.radians(33.0)))


def test_phases_are_distinct_places_within_a_voxel() -> None:
    offsets = np.array(phase_offsets(8))
    assert np.abs(offsets).max() < 0.5
    distances = np.linalg.norm(offsets[:, None] - offsets[None], axis=-1)
    assert distances[~np.eye(8, dtype=bool)].min() > 0.2


def test_mean_and_spread_are_the_textbook_ones() -> None:
    values = [1.0, 2.0, 3.0, 4.0]
    mean, spread = mean_of(values), spread_of(values)
    # Student: t(3, 0.975) = 3.1824; chi squared(3): 0.21580 and 9.3484.
    error = math.sqrt(5.0 / 3.0 / 4.0)
    assert (mean.value, mean.low) == pytest.approx((2.5, 2.5 - 3.1824 * error), abs=1e-3)
    assert spread.value == pytest.approx(math.sqrt(5.0 / 3.0))
    assert (spread.low, spread.high) == pytest.approx(
        (math.sqrt(5.0 / 9.3484), math.sqrt(5.0 / 0.21580)), rel=1e-3
    )


def test_one_value_has_no_interval_and_none_no_mean() -> None:
    assert mean_of([2.0]).low is None
    with pytest.raises(ValueError, match="nothing to take the mean of"):
        mean_of([])
    with pytest.raises(ValueError, match="fewer than two"):
        spread_of([1.0])
