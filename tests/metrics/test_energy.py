from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics import energy_ratio, jackknife

ROUNDING = 1e-12
"""Sums of a few hundred float64 values near 1."""


def test_five_percent_more_light() -> None:
    assert energy_ratio(np.full((4, 4, 3), 1.05), np.ones((3, 4, 4, 3))).value == pytest.approx(
        1.05, abs=ROUNDING
    )


def test_closed_form_equals_the_general_jackknife(truth: NDArray[np.float64]) -> None:
    batches = truth * np.random.default_rng(4).gamma(4.0, 0.25, size=(5, *truth.shape))
    slow = jackknife(lambda some: float(truth.mean() / some.mean()), batches)
    fast = energy_ratio(truth, batches)
    assert fast.value == pytest.approx(slow.value, abs=ROUNDING)
    assert fast.low == pytest.approx(slow.low, abs=ROUNDING)
    assert fast.high == pytest.approx(slow.high, abs=ROUNDING)


def test_black_reference_has_no_ratio() -> None:
    with pytest.raises(ValueError, match=r"'indirect_specular' must hold light.*mse"):
        energy_ratio(np.ones((4, 4, 3)), np.zeros((3, 4, 4, 3)), component="indirect_specular")


def test_light_in_one_batch_alone_has_no_interval() -> None:
    batches = np.zeros((3, 4, 4, 3))
    batches[1, 2, 2] = 1.0
    with pytest.raises(ValueError, match="light in at least two"):
        energy_ratio(np.ones((4, 4, 3)), batches)
