"""The evolution strategy finds what closed forms say, and only depends on its seed."""

from __future__ import annotations

import math

import numpy as np

from experiments.optimize.evolution import minimise_by_evolution
from experiments.optimize.parameters import CHOICES, SINGLE, Parameter

PARAMETERS: list[Parameter] = [CHOICES["sparsity"], CHOICES["traced_once"], SINGLE["level_bias"]]
START = np.array([16.0, 0.0, 0.5])

NEAR = 0.15
"""Distance to the best bias that 120 trials leave: steps are then a fortieth of the bounds."""


class Valley:
    """Smallest at sparsity 4, traced once, bias -1.5; dense pixels are refused."""

    def __init__(self) -> None:
        self.points: list[tuple[float, ...]] = []

    def value(self, point: np.ndarray) -> float:
        """Return the height."""
        self.points.append(tuple(point))
        if point[0] == 1.0:
            return math.inf
        return float(abs(point[0] - 4.0) + (1.0 - point[1]) + (point[2] + 1.5) ** 2)


def test_it_finds_choices_and_numbers_together() -> None:
    valley = Valley()
    found = minimise_by_evolution(valley, PARAMETERS, START, trials=120, seed=0)
    assert found.point[:2].tolist() == [4.0, 1.0]
    assert abs(found.point[2] + 1.5) < NEAR
    assert found.value == Valley().value(found.point)
    assert valley.points[0] == tuple(START), "the start is tried first, so nothing worse comes out"


def test_every_point_is_allowed_and_new() -> None:
    valley = Valley()
    minimise_by_evolution(valley, PARAMETERS, START, trials=60, seed=1)
    for sparsity, once, bias in valley.points:
        assert sparsity in (1, 4, 9, 16)
        assert once in (0, 1)
        assert SINGLE["level_bias"].low <= bias <= SINGLE["level_bias"].high
    assert len(set(valley.points)) > 50


def test_a_longer_run_begins_with_the_shorter_one() -> None:
    short, long, other = Valley(), Valley(), Valley()
    minimise_by_evolution(short, PARAMETERS, START, trials=20, seed=3)
    minimise_by_evolution(long, PARAMETERS, START, trials=40, seed=3)
    minimise_by_evolution(other, PARAMETERS, START, trials=20, seed=4)
    assert long.points[:20] == short.points
    assert other.points[1:] != short.points[1:]


def test_a_single_trial_is_the_start() -> None:
    found = minimise_by_evolution(Valley(), PARAMETERS, START, trials=1, seed=0)
    assert found.point.tolist() == START.tolist()
