"""Gauss-Newton in a trust region with bounds, from an objective's value, gradient and curvature.

SciPy's `least_squares` does the steps. It wants residuals and their Jacobian; an objective F that
is a sum of squares is told to it by one residual ``sqrt(2 F)`` and a Jacobian whose last row is
``g / sqrt(2 F)`` and whose others are a square root of ``H - g g^T / (2 F)``. Then J^T f = g and
J^T J = H, which is all that the method reads, so that pictures need not be kept; and the Jacobian
is asked for at accepted points alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from experiments.optimize.target import Array


@dataclass(frozen=True, kw_only=True)
class LocalModel:
    """An objective near a point.

    Attributes
    ----------
    value
        F >= 0.
    gradient
        dF / dx, [parameter].
    curvature
        Second derivatives in the approximation of Gauss and Newton, [parameter, parameter].
    """

    value: float
    gradient: Array
    curvature: Array


class SmoothObjective(Protocol):
    """A sum of squares to be made small."""

    def value(self, point: Array) -> float:
        """Return F >= 0, or infinity where a point is refused; the start never is."""

    def model(self, point: Array) -> LocalModel:
        """Return F and its derivatives."""


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Where an optimiser ended.

    Attributes
    ----------
    point
        [parameter].
    value
        F there.
    evaluations
        Points whose value was asked for.
    message
        Why it ended.
    """

    point: Array
    value: float
    evaluations: int
    message: str


@dataclass(frozen=True, kw_only=True)
class StopRule:
    """When to end."""

    evaluations: int = 30
    """Most points."""
    tolerance: float = 1e-4
    """Relative change of F, or of the point, below which a step is the last."""


STOP_RULE = StopRule()

INSIDE = 1e-3
"""Share of the bounds' distance by which a start on a bound is moved off it."""


def minimise(
    objective: SmoothObjective,
    start: Array,
    low: Array,
    high: Array,
    stop: StopRule = STOP_RULE,
    tell: Callable[[int], None] = lambda _count: None,
) -> Minimum:
    """Minimise a sum of squares.

    Parameters
    ----------
    objective
        What is minimised.
    start, low, high
        [parameter] where to begin, and bounds with low < high.
    stop
        When to end.
    tell
        Told how many points have been tried.
    """
    count = 0
    best = (np.inf, start)

    def residuals(point: Array) -> Array:
        nonlocal count, best
        count += 1
        tell(count)
        value = objective.value(point)
        if value < best[0]:
            best = (value, point.copy())
        found = np.zeros(len(point) + 1)
        # SciPy shrinks its step where a residual is infinite.
        found[-1] = np.sqrt(2.0 * value)
        return found

    def jacobian(point: Array) -> Array:
        return compressed_jacobian(objective.model(point))

    margin = INSIDE * (high - low)
    done = least_squares(
        residuals,
        np.clip(start, low + margin, high - margin),
        jac=jacobian,
        bounds=(low, high),
        x_scale=1.0,
        method="trf",
        ftol=stop.tolerance,
        xtol=stop.tolerance,
        gtol=None,
        max_nfev=stop.evaluations,
    )
    value, point = best
    return Minimum(point=point, value=value, evaluations=count, message=str(done.message))


def compressed_jacobian(model: LocalModel) -> Array:
    """Return J of the residuals (0, .., 0, sqrt(2 F)), [parameter + 1, parameter]."""
    length = np.sqrt(2.0 * model.value)
    last = model.gradient / length if length > 0.0 else np.zeros_like(model.gradient)
    rest = model.curvature - np.outer(last, last)
    values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
    # By Cauchy and Schwarz none is below 0 where H is J^T J; an estimate of H may miss that.
    rows = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return np.vstack([rows, last])
