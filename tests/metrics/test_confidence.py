from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import t as student

from metrics import jackknife
from metrics.confidence import estimate_from_leave_one_out, jackknife_of_mean

ROUNDING = 1e-12
"""Sums of a few hundred float64 values near 1."""


@pytest.fixture
def batches() -> NDArray[np.float64]:
    return np.random.default_rng(3).gamma(2.0, 0.5, size=(6, 4, 5, 3))


@pytest.mark.parametrize("level", [0.5, 0.95, 0.99])
def test_interval_of_a_mean_is_the_t_interval(batches: NDArray[np.float64], level: float) -> None:
    means = batches.mean(axis=(1, 2, 3))
    half_width = student.ppf(0.5 + level / 2, 5) * means.std(ddof=1) / np.sqrt(6)
    estimate = jackknife(lambda some: float(some.mean()), batches, level)
    assert estimate.value == pytest.approx(means.mean(), abs=ROUNDING)
    assert estimate.low == pytest.approx(means.mean() - half_width, abs=ROUNDING)
    assert estimate.high == pytest.approx(means.mean() + half_width, abs=ROUNDING)
    assert estimate.level == level


def test_bias_of_a_square_is_removed_exactly(batches: NDArray[np.float64]) -> None:
    means = batches.mean(axis=(1, 2, 3))
    estimate = jackknife(lambda some: float(some.mean()) ** 2, batches)
    without_bias = means.mean() ** 2 - means.var(ddof=1) / 6
    assert estimate.value == pytest.approx(without_bias, abs=ROUNDING)
    assert estimate.high >= means.mean() ** 2


def test_fast_jackknife_of_the_mean_equals_the_slow_one(batches: NDArray[np.float64]) -> None:
    slow = jackknife(lambda some: float(np.sqrt(some.mean(axis=0)).mean()), batches)
    fast = jackknife_of_mean(lambda mean: float(np.sqrt(mean).mean()), batches)
    assert fast.value == pytest.approx(slow.value, abs=ROUNDING)
    assert fast.low == pytest.approx(slow.low, abs=ROUNDING)
    assert fast.high == pytest.approx(slow.high, abs=ROUNDING)


def test_equal_batches_give_an_interval_of_no_width() -> None:
    estimate = jackknife(lambda some: float(some.mean()), np.full((4, 2, 2, 3), 0.25))
    assert (estimate.low, estimate.value, estimate.high) == (0.25, 0.25, 0.25)


def test_noise_floor_lowers_the_low_end_alone() -> None:
    without_one = np.array([1.0, 1.1, 0.9])
    bare = estimate_from_leave_one_out(1.0, without_one)
    allowed = estimate_from_leave_one_out(1.0, without_one, noise_floor=0.3)
    assert allowed.low == pytest.approx(bare.low - 0.3, abs=ROUNDING)
    assert (allowed.value, allowed.high) == (bare.value, bare.high)


def test_one_batch_has_no_interval() -> None:
    with pytest.raises(ValueError, match="at least 2 independent references, got 1"):
        jackknife(lambda some: float(some.mean()), np.ones((1, 2, 2, 3)))
    with pytest.raises(ValueError, match="at least 2 entries, got 1"):
        estimate_from_leave_one_out(1.0, np.ones(1))


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0, float("nan")])
def test_level_is_a_probability(batches: NDArray[np.float64], level: float) -> None:
    with pytest.raises(ValueError, match="level must be in"):
        jackknife(lambda some: float(some.mean()), batches, level)
