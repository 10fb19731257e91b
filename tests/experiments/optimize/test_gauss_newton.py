"""Gauss-Newton on problems whose minimum is known."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from experiments.optimize.gauss_newton import (
    LocalModel,
    StopRule,
    compressed_jacobian,
    minimise,
)
from experiments.optimize.target import Array
from tests.experiments.optimize.known_problems import Residuals, exponential_fit

EXACT = StopRule(evaluations=100, tolerance=1e-12)
DOUBLE_PRECISION = 1e-6
"""Root of the relative change that ends the search."""


def linear(matrix: Array, right: Array, **rest: Callable[[Array], bool]) -> Residuals:
    return Residuals(lambda x: matrix @ x - right, lambda _x: matrix, **rest)


def exponential(rate: float, size: float) -> Residuals:
    """Fit size exp(-rate t) to exact values at eight times."""
    t = np.linspace(0.0, 2.0, 8)
    return exponential_fit(t, size * np.exp(-rate * t))


def test_a_quadratic_is_solved_in_a_few_points() -> None:
    rng = np.random.default_rng(1)
    matrix, truth = rng.normal(size=(20, 3)), np.array([0.3, -0.7, 1.1])
    problem = linear(matrix, matrix @ truth + 0.1)
    exact = np.linalg.lstsq(matrix, matrix @ truth + 0.1, rcond=None)[0]
    found = minimise(problem, np.zeros(3), np.full(3, -2.0), np.full(3, 2.0), EXACT)
    assert found.point == pytest.approx(exact, abs=DOUBLE_PRECISION)
    assert found.evaluations < 15
    assert found.value == pytest.approx(float(np.sum((matrix @ exact - matrix @ truth - 0.1) ** 2)))


def test_an_exponential_gives_back_its_size_and_rate() -> None:
    low, high = np.array([0.1, 0.05]), np.array([10.0, 5.0])
    found = minimise(exponential(1.3, 2.5), np.array([1.0, 0.3]), low, high, EXACT)
    assert found.point == pytest.approx([2.5, 1.3], rel=DOUBLE_PRECISION)


def test_a_minimum_beyond_a_bound_ends_at_the_bound() -> None:
    problem = linear(np.eye(2), np.array([3.0, 0.5]))
    found = minimise(problem, np.zeros(2), np.full(2, -1.0), np.full(2, 1.0), EXACT)
    assert found.point == pytest.approx([1.0, 0.5], abs=1e-3)


def test_a_start_on_a_bound_is_no_obstacle() -> None:
    problem = linear(np.eye(2), np.array([0.2, 0.5]))
    found = minimise(problem, np.array([-1.0, 1.0]), np.full(2, -1.0), np.full(2, 1.0), EXACT)
    assert found.point == pytest.approx([0.2, 0.5], abs=DOUBLE_PRECISION)


def test_a_refused_region_is_never_entered_by_the_result() -> None:
    problem = linear(np.eye(2), np.array([1.5, 0.5]), refuses=lambda x: bool(x[0] > 0.6))
    found = minimise(problem, np.zeros(2), np.full(2, -2.0), np.full(2, 2.0))
    assert found.point[0] <= 0.6
    assert found.value < float(np.sum(np.array([1.5, 0.5]) ** 2))


def test_derivatives_are_asked_for_at_accepted_points_alone() -> None:
    problem = exponential(1.3, 2.5)
    models: list[Array] = []
    model = problem.model

    def counted(point: Array) -> LocalModel:
        models.append(point)
        return model(point)

    problem.model = counted  # type: ignore[method-assign]
    found = minimise(problem, np.array([1.0, 0.3]), np.array([0.1, 0.05]), np.array([10.0, 5.0]))
    assert len(models) <= found.evaluations


def test_the_compressed_jacobian_has_the_gradient_and_the_curvature() -> None:
    rng = np.random.default_rng(2)
    r, j = rng.normal(size=9), rng.normal(size=(9, 4))
    value = 0.5 * float(r @ r)
    packed = compressed_jacobian(LocalModel(value=value, gradient=j.T @ r, curvature=j.T @ j))
    residuals = np.array([0.0, 0.0, 0.0, 0.0, math.sqrt(2.0 * value)])
    assert packed.T @ residuals == pytest.approx(j.T @ r)
    assert packed.T @ packed == pytest.approx(j.T @ j)


def test_the_number_of_points_is_bounded() -> None:
    problem = exponential(1.3, 2.5)
    found = minimise(
        problem,
        np.array([1.0, 0.3]),
        np.array([0.1, 0.05]),
        np.array([10.0, 5.0]),
        StopRule(evaluations=3),
    )
    assert found.evaluations == len(problem.asked) == 3
