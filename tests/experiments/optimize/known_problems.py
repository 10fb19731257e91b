"""Problems of least squares whose answer is known."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from experiments.optimize.gauss_newton import LocalModel
from experiments.optimize.target import Array


class Residuals:
    """A sum of squares from residuals and their Jacobian; refused points are infinite."""

    def __init__(
        self,
        residuals: Callable[[Array], Array],
        jacobian: Callable[[Array], Array],
        refuses: Callable[[Array], bool] = lambda _point: False,
    ) -> None:
        self.residuals, self.jacobian, self.refuses = residuals, jacobian, refuses
        self.asked: list[Array] = []

    def value(self, point: Array) -> float:
        self.asked.append(point.copy())
        return math.inf if self.refuses(point) else float(np.sum(self.residuals(point) ** 2))

    def model(self, point: Array) -> LocalModel:
        r, j = self.residuals(point), self.jacobian(point)
        return LocalModel(value=float(r @ r), gradient=2.0 * j.T @ r, curvature=2.0 * j.T @ j)


def exponential_fit(t: Array, seen: Array) -> Residuals:
    """Fit x[0] exp(-x[1] t) to what is seen."""

    def residuals(x: Array) -> Array:
        found: Array = x[0] * np.exp(-x[1] * t) - seen
        return found

    def jacobian(x: Array) -> Array:
        falling = np.exp(-x[1] * t)
        return np.stack([falling, -x[0] * t * falling], axis=1)

    return Residuals(residuals, jacobian)
