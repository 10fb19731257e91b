"""Intervals of parameters: the textbook's formula, their coverage, and what is not identified."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.optimize.gauss_newton import StopRule, minimise
from experiments.optimize.intervals import gradient_covariance, held_by_bounds, uncertainty
from experiments.optimize.target import Array
from tests.experiments.optimize.known_problems import Residuals, exponential_fit

RANGES = np.array([10.0, 10.0])
NONE_HELD = np.zeros(2, dtype=bool)


def frame_gradients(problems: list[Residuals], point: Array) -> Array:
    return np.stack([each.model(point).gradient for each in problems])


def test_independent_residuals_give_the_formula_of_the_textbook() -> None:
    # y = X b + noise of variance s^2: the covariance of b is s^2 (X^T X)^-1.
    rng = np.random.default_rng(3)
    matrix, noise, count = rng.normal(size=(50, 2)), 0.1, 400
    right = matrix @ np.array([1.0, 2.0]) + noise * rng.normal(size=(count, 50))
    gradients = 2.0 * (matrix @ np.array([1.0, 2.0]) - right) @ matrix
    covariance, degrees = gradient_covariance([gradients])
    found = uncertainty(2.0 * matrix.T @ matrix, covariance, degrees, RANGES, NONE_HELD)
    exact = noise * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) / count)
    assert found.half_widths == pytest.approx(1.966 * exact, rel=0.15)
    assert degrees == count - 1
    assert found.is_identified.all()


def stacked(frames: list[Residuals]) -> Residuals:
    return Residuals(
        lambda x: np.concatenate([each.residuals(x) for each in frames]),
        lambda x: np.concatenate([each.jacobian(x) for each in frames]),
    )


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    t, truth, noise = np.linspace(0.0, 2.0, 12), np.array([2.5, 1.3]), 0.05
    low, high = np.array([0.1, 0.05]), np.array([10.0, 5.0])
    held, trials = np.zeros(2), 200
    rng = np.random.default_rng(4)
    for _ in range(trials):
        frames = []
        for _ in range(6):
            seen = truth[0] * np.exp(-truth[1] * t) + noise * rng.normal(size=len(t))
            frames.append(exponential_fit(t, seen))
        whole = stacked(frames)
        point = minimise(whole, np.array([2.0, 1.0]), low, high, StopRule(tolerance=1e-10)).point
        covariance, degrees = gradient_covariance([frame_gradients(frames, point)])
        curvature = frames[0].model(point).curvature
        found = uncertainty(curvature, covariance, degrees, high - low, NONE_HELD)
        held += np.abs(point - truth) <= found.half_widths
    # 95 % of 200 is 190, with a standard deviation of 3.
    assert held == pytest.approx(190, abs=12)


def test_a_sum_does_not_tell_its_parts() -> None:
    curvature = np.array([[1.0, 1.0], [1.0, 1.0]])
    found = uncertainty(curvature, 1e-4 * np.eye(2), 10, RANGES, NONE_HELD)
    assert not found.is_identified.any()
    assert found.condition > 1e8


def test_a_parameter_that_changes_nothing_is_named_and_the_other_is_known() -> None:
    curvature = np.diag([4.0, 0.0])
    found = uncertainty(curvature, 1e-4 * np.eye(2), 10, RANGES, NONE_HELD)
    assert found.is_identified.tolist() == [True, False]
    assert np.isinf(found.half_widths[1])


def test_an_interval_as_wide_as_the_bounds_identifies_nothing() -> None:
    found = uncertainty(np.eye(2), 100.0 * np.eye(2), 10, RANGES, NONE_HELD)
    assert not found.is_identified.any()


def test_a_parameter_at_its_bound_is_known_and_widens_no_other() -> None:
    low, high = np.zeros(2), RANGES
    held = held_by_bounds(np.array([1e-4, 5.0]), np.array([3.0, 0.0]), low, high)
    assert held.tolist() == [True, False]
    curvature = np.array([[2.0, 1.9], [1.9, 2.0]])
    found = uncertainty(curvature, 0.01 * np.eye(2), 10, RANGES, held)
    assert found.half_widths[0] == 0.0
    assert found.half_widths[1] == pytest.approx(2.228 * 0.1 / 2.0, rel=1e-3)


def test_one_frame_tells_no_noise() -> None:
    with pytest.raises(ValueError, match="at least two"):
        gradient_covariance([np.zeros((1, 2))])
