"""Discrete choices by Optuna, and what happens without it."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.optimize.discrete import minimise_by_trials
from experiments.optimize.parameters import CHOICES, SINGLE
from experiments.optimize.target import Array

PARAMETERS = [CHOICES["cone_count"], SINGLE["start_offset"]]
START = np.array([17.0, 1.0])


class Valley:
    """Best at nine cones and an offset of 2; more than 32 cones are refused."""

    def value(self, point: Array) -> float:
        if point[0] > 32.0:
            return math.inf
        return float((point[0] - 9.0) ** 2 / 100.0 + (point[1] - 2.0) ** 2)


def test_the_best_choice_is_found_again_with_the_same_seed() -> None:
    pytest.importorskip("optuna", reason="needs the extra 'tune'")
    found = [minimise_by_trials(Valley(), PARAMETERS, START, trials=60, seed=1) for _ in range(2)]
    assert found[0].value < 0.1
    assert found[0].point[0] in CHOICES["cone_count"].options  # type: ignore[operator]
    assert np.array_equal(found[0].point, found[1].point)


def test_the_start_is_the_first_trial() -> None:
    pytest.importorskip("optuna", reason="needs the extra 'tune'")
    found = minimise_by_trials(Valley(), PARAMETERS, START, trials=1, seed=1)
    assert np.array_equal(found.point, START)


def test_without_optuna_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(InputError, match=r"vctgi\[tune\]"):
        minimise_by_trials(Valley(), PARAMETERS, START, trials=1, seed=1)
