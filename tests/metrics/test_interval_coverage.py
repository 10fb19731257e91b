"""How often an interval holds the true value.

Many references are drawn for one test image. ``--junitxml`` writes each measured coverage.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from metrics import (
    DisplaySettings,
    Measurement,
    delta_e_2000,
    delta_e_itp,
    display_settings,
    energy_ratio,
    mean_flip,
    mean_relative_error,
    mse,
    reference_noise_relmse,
    relmse_e001,
    relmse_e2,
    ssim_pq,
)

Array = NDArray[np.float64]
Metric = Callable[[Array, Array, DisplaySettings], Measurement]
Draw = Callable[[Array, np.random.Generator], Array]

BATCH_COUNT = 8
TRIAL_COUNT = 250
SLOW_TRIAL_COUNT = 80
"""For the metrics that take several milliseconds even on a 16 x 16 image."""
SLOW_METRICS = {"flip", "delta_e_2000"}
LEVEL = 0.95
FALSE_ALARM = 1e-3
"""Probability that an exact 95 % interval fails one of these tests; seeds are fixed."""

METRICS: dict[str, Metric] = {
    "energy_ratio": lambda v, r, _: energy_ratio(v, r),
    "mse": lambda v, r, _: mse(v, r),
    "relmse_e2": lambda v, r, _: relmse_e2(v, r),
    "relmse_e001": lambda v, r, _: relmse_e001(v, r),
    "mre": lambda v, r, _: mean_relative_error(v, r),
    "flip": lambda v, r, display: mean_flip(v, r, display.flip),
    "ssim_pq": lambda v, r, display: ssim_pq(v, r, nits_per_unit=display.nits_per_unit),
    "delta_e_itp": lambda v, r, display: delta_e_itp(v, r, nits_per_unit=display.nits_per_unit),
    "delta_e_2000": lambda v, r, display: delta_e_2000(v, r, exposure=display.exposure),
}

HEAVY_TAIL_FLOOR = {name: 0.90 for name in METRICS} | {
    "energy_ratio": 0.82,
    "relmse_e2": 0.55,
    "relmse_e001": 0.55,
}
"""Least coverage accepted under fireflies: a t interval does not see the ones that did not fall.

metrics/README.md states what was measured.
"""

FIREFLY_PROBABILITY = 2e-3
FIREFLY_SCALE = 10.0
FIREFLY_TAIL = 2.5


def even_noise(truth: Array, generator: np.random.Generator) -> Array:
    return truth * (1.0 + 0.1 * generator.normal(size=(BATCH_COUNT, *truth.shape)))


def skewed_noise(truth: Array, generator: np.random.Generator) -> Array:
    return truth * generator.gamma(4.0, 0.25, size=(BATCH_COUNT, *truth.shape))


def fireflies(truth: Array, generator: np.random.Generator) -> Array:
    """Gamma noise, and on one sample in 500 a white Pareto spike with infinite third moment."""
    body = truth * generator.gamma(11.0, 1 / 11.0, size=(BATCH_COUNT, *truth.shape))
    shape = (BATCH_COUNT, *truth.shape[:2], 1)
    hit = generator.random(shape) < FIREFLY_PROBABILITY
    return body + hit * FIREFLY_SCALE * generator.pareto(FIREFLY_TAIL, size=shape)


FIREFLY_MEAN = FIREFLY_PROBABILITY * FIREFLY_SCALE / (FIREFLY_TAIL - 1.0)


def structured_test(truth: Array) -> Array:
    """Give the truth an error that varies over the image."""
    return truth * (1.0 + 0.3 * np.sin(np.arange(truth.shape[1])))[None, :, None] + 0.05


def covered(name: str, test: Array, truth: Array, mean: Array, draw: Draw) -> tuple[int, int]:
    """Count the trials whose interval holds the true value; also return how many were made."""
    display = display_settings(truth)
    metric = METRICS[name]
    exact = metric(test, np.stack([mean] * 4), display).value
    generator = np.random.default_rng(5)
    trials = SLOW_TRIAL_COUNT if name in SLOW_METRICS else TRIAL_COUNT
    hits = 0
    for _ in range(trials):
        result = metric(test, draw(truth, generator), display)
        assert result.low is not None
        assert result.high is not None
        hits += result.low <= exact <= result.high
    return hits, trials


@pytest.mark.parametrize("draw", [even_noise, skewed_noise])
@pytest.mark.parametrize("is_exact", [False, True], ids=["wrong_test", "true_test"])
@pytest.mark.parametrize("name", METRICS)
def test_coverage(
    name: str,
    is_exact: bool,
    draw: Draw,
    truth: Array,
    record_property: Callable[[str, object], None],
) -> None:
    test = truth if is_exact else structured_test(truth)
    hits, trials = covered(name, test, truth, truth, draw)
    record_property("coverage", hits / trials)
    assert hits >= binom.ppf(FALSE_ALARM, trials, LEVEL)


@pytest.mark.parametrize("name", ["energy_ratio", "mse"])
def test_coverage_is_not_larger_than_stated_where_theory_is_exact(name: str, truth: Array) -> None:
    hits, trials = covered(name, structured_test(truth), truth, truth, even_noise)
    assert hits <= binom.ppf(1 - FALSE_ALARM, trials, LEVEL)


@pytest.mark.parametrize("name", METRICS)
def test_coverage_under_fireflies(
    name: str, truth: Array, record_property: Callable[[str, object], None]
) -> None:
    hits, trials = covered(name, structured_test(truth), truth, truth + FIREFLY_MEAN, fireflies)
    record_property("coverage", hits / trials)
    assert hits >= HEAVY_TAIL_FLOOR[name] * trials


@pytest.mark.parametrize("name", METRICS)
def test_less_noise_gives_a_narrower_interval(name: str, truth: Array) -> None:
    display = display_settings(truth)
    noise = np.random.default_rng(9).normal(size=(BATCH_COUNT, *truth.shape))
    widths = []
    for strength in (0.1, 0.0125):
        batches = truth * (1.0 + strength * noise)
        result = METRICS[name](structured_test(truth), batches, display)
        assert result.low is not None
        assert result.high is not None
        widths.append(result.high - result.low)
    # An eighth of the noise, and FLIP grows with a power of about 0.7 of a difference.
    assert widths[1] < 0.3 * widths[0]


def test_coverage_of_the_reference_noise(truth: Array) -> None:
    mean_luminance = float((truth @ [0.2126, 0.7152, 0.0722]).mean())
    variance_of_mean = (0.1 * truth) ** 2 / BATCH_COUNT
    exact = float((variance_of_mean / (truth**2 + 0.01 * mean_luminance**2)).mean())
    generator = np.random.default_rng(6)
    estimates = [reference_noise_relmse(even_noise(truth, generator)) for _ in range(TRIAL_COUNT)]
    hits = sum(estimate.low <= exact <= estimate.high for estimate in estimates)
    assert hits >= binom.ppf(FALSE_ALARM, TRIAL_COUNT, LEVEL)
