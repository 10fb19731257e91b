"""How often noise alone fails a gate: the reference drawn anew, for baseline and record."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import stats

from experiments.errors import MachineryError
from experiments.gate.baseline import reference_of
from experiments.gate.equality import critical_value, difference_in_errors, measured_from
from experiments.gate.evaluation import evaluate
from experiments.gate.scales import Estimate

if TYPE_CHECKING:
    from tests.experiments.gate.conftest import Bench

DRAWS = 300
NOISY_BATCH = 0.03
"""Half-widths of relMSE near 0.95 % then: three quarters of what a tolerance of 5 % allows."""


def test_300_redrawn_references_raise_no_alarm(
    bench: Bench, record_property: Callable[[str, object], None]
) -> None:
    """The render stays the same; every check of the gate must pass in every draw."""
    bench.batch_noise = NOISY_BATCH
    gate = bench.gate()
    alarms: list[str] = []
    refusals: list[str] = []
    seeds = iter(range(10 * DRAWS))
    pairs = 0
    while pairs < DRAWS:
        source, source_path = bench.record(seed=next(seeds))
        baseline = bench.baseline(gate, source)
        own = [v for v in evaluate(source, source_path, gate, baseline) if not v.passed]
        if own:
            refusals += [v.message for v in own]
            continue
        pairs += 1
        record, path = bench.record(seed=next(seeds))
        assert baseline.reference != reference_of(record)
        alarms += [v.message for v in evaluate(record, path, gate, baseline) if not v.passed]
    record_property("false_alarms", len(alarms))
    record_property("baselines_refused_as_too_noisy", len(refusals))
    assert alarms == []
    assert all("noise fails the gate" in message for message in refusals)
    assert len(refusals) < DRAWS


def test_every_redrawn_reference_shows_energy_times_1_05(bench: Bench) -> None:
    bench.batch_noise = NOISY_BATCH
    gate = bench.gate()
    baseline = bench.baseline(gate, bench.record(seed=0)[0])
    for seed in range(1, 51):
        record, path = bench.record(seed=seed, render=bench.render * 1.05)
        failed = {v.gate for v in evaluate(record, path, gate, baseline) if not v.passed}
        assert "bench: energy_ratio of indirect" in failed


@pytest.mark.parametrize("significance", [0.05, 0.001])
@pytest.mark.parametrize("batch_counts", [(8, 8), (4, 16)])
def test_equality_gives_the_false_alarms_that_it_promises(
    significance: float, batch_counts: tuple[int, int]
) -> None:
    """Means of normal batches around one true value, with their t-intervals."""
    draws = 2000
    rng = np.random.default_rng(5)
    alarms = 0
    for _ in range(draws):
        sides = []
        for count in batch_counts:
            batches = rng.normal(1.0, 0.1, count)
            quantile = stats.t.ppf(0.975, count - 1)
            half = float(quantile * batches.std(ddof=1) / np.sqrt(count))
            mean = float(batches.mean())
            estimate = Estimate(mean, mean - half, mean + half)
            sides.append(measured_from(estimate, level=0.95, batch_count=count, where="here"))
        distance, freedom = difference_in_errors(sides[0], sides[1])
        alarms += distance > critical_value(significance, freedom)
    # One chance in ten thousand that a test which keeps its promise exceeds this count.
    assert alarms <= stats.binom.ppf(0.9999, draws, significance)


def test_one_batch_has_no_spread() -> None:
    with pytest.raises(MachineryError, match="one batch has no spread"):
        measured_from(Estimate(1.0, 0.9, 1.1), level=0.95, batch_count=1, where="here")


def test_numbers_without_spread_are_equal_only_if_they_are_the_same() -> None:
    exact = measured_from(Estimate(1.0, 1.0, 1.0), level=0.95, batch_count=8, where="here")
    other = measured_from(Estimate(2.0, 2.0, 2.0), level=0.95, batch_count=8, where="here")
    assert difference_in_errors(exact, exact)[0] == 0.0
    assert difference_in_errors(exact, other)[0] == np.inf
