"""Adam on problems whose minimum is known, and against Dr.Jit's own."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.optimize.adam import AdamOptions, minimise_by_adam
from experiments.optimize.target import Array

LOW, HIGH = np.full(3, -2.0), np.full(3, 2.0)
SINGLE_PRECISION = 1e-4
"""Forty steps in single precision."""


class Bowl:
    """Mean of squares around one centre a group."""

    def __init__(self, centres: Array) -> None:
        self.centres = centres

    @property
    def group_count(self) -> int:
        return len(self.centres)

    def group_gradient(self, point: Array, group: int) -> Array:
        found: Array = 2.0 * (point - self.centres[group])
        return found

    def value(self, point: Array) -> float:
        return float(np.mean(np.sum((point - self.centres) ** 2, axis=1)))


def test_the_minimum_of_several_groups_is_their_mean() -> None:
    centres = np.array([[0.4, -0.1, 0.9], [0.6, 0.1, 0.7]])
    found = minimise_by_adam(
        Bowl(centres), np.zeros(3), LOW, HIGH, AdamOptions(iterations=400, rate=0.05)
    )
    assert found.point == pytest.approx(centres.mean(axis=0), abs=0.02)


def test_bounds_hold() -> None:
    bowl = Bowl(np.array([[5.0, 0.0, 0.0]]))
    found = minimise_by_adam(bowl, np.zeros(3), LOW, HIGH, AdamOptions(iterations=100, rate=0.1))
    assert found.point[0] == 2.0


def test_the_start_is_kept_where_nothing_is_better() -> None:
    bowl = Bowl(np.zeros((1, 3)))
    found = minimise_by_adam(bowl, np.zeros(3), LOW, HIGH, AdamOptions(iterations=5))
    assert found.value == 0.0
    assert found.point == pytest.approx(np.zeros(3))


def test_steps_are_those_of_drjit(variant: str) -> None:
    centre = np.array([[0.4, -0.1, 0.9]])
    options = AdamOptions(iterations=40, rate=0.01, final_rate=1.0, check_every=40)
    found = minimise_by_adam(Bowl(centre), np.zeros(3), LOW, HIGH, options)
    from drjit.opt import Adam

    opt = Adam(lr=0.01, beta_1=options.beta_1, beta_2=options.beta_2, epsilon=options.epsilon)
    opt["x"] = mi.Float([0.0, 0.0, 0.0])
    for _ in range(40):
        loss = dr.sum(dr.square(opt["x"] - mi.Float(centre[0].tolist())))
        dr.backward(loss)
        opt.step()
    assert found.point == pytest.approx(np.array(opt["x"]), abs=SINGLE_PRECISION)
