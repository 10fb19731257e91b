"""How often an unchanged renderer fails its gates, and how small a fault still does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import betaincinv

from experiments.gate.baseline import Baseline
from experiments.gate.update import baseline_from_record
from experiments.studies.check import INTERVAL_LEVEL, Measured, StudyContext
from experiments.studies.gates.draws import (
    BATCHES_EACH,
    Draw,
    Fault,
    draw,
    failed_kinds,
    gate_of,
    judge,
    judge_equal,
    judge_order,
    judge_time,
    record_of,
)
from experiments.studies.gates.pool import Pool, rendered_pool
from reference import NoisyReferenceError

RUNS = 200
"""Baselines and records that are drawn, each an unchanged renderer."""

SHARE_FOUND = 0.95
"""Share of the runs in which a regression must be found."""

SEED: Final = 8
RESOLUTION = 0.001
"""How exactly the smallest regression is known, in shares of the energy."""

LARGEST = (0.1, 0.4)
"""Where its search begins; in the whole study and in the quick one."""

NO_VERDICT: Final = ("error", "refused")
"""Kinds of verdict that decide nothing."""


@dataclass(frozen=True)
class Run:
    """One draw with its baseline, and the kinds that failed although nothing had changed."""

    drawn: Draw
    baseline: Baseline
    alarms: frozenset[str]
    fixed_alarms: frozenset[str]
    """The same where the cones of both have one seed, as in `vctgi gate`."""
    is_timed: bool
    """Whether the times of the baseline were quiet enough for a budget."""


@dataclass(frozen=True)
class Outcome:
    """What all runs gave."""

    runs: list[Run]
    refused: int
    """Baselines that were refused as too noisy, which were drawn anew."""
    smallest: dict[str, float]
    """Smallest fault, by its name, that `SHARE_FOUND` of the runs find."""


def more_energy(share: float) -> Fault:
    """Scale all indirect light up."""
    return lambda light, _: light * (1.0 + share)


def less_energy(share: float) -> Fault:
    """Scale all indirect light down."""
    return lambda light, _: light * (1.0 - share)


def leaked_light(share: float) -> Fault:
    """Add light where the reference is in its darkest quarter, `share` of the picture's energy."""

    def add(light: np.ndarray, truth: np.ndarray) -> np.ndarray:
        brightness = truth.mean(axis=2)
        dark = brightness <= np.quantile(brightness, 0.25)
        added = np.zeros_like(light)
        added[dark] = share * light.mean() * light.shape[0] * light.shape[1] / dark.sum()
        leaked: np.ndarray = light + added
        return leaked

    return add


FAULTS: dict[str, Callable[[float], Fault]] = {
    "more energy": more_energy,
    "less energy": less_energy,
    "leaked light": leaked_light,
}
"""What is planted, by a share of the indirect light's energy."""


def outcome(context: StudyContext) -> Outcome:
    """Return what all runs gave, rendered and drawn once.

    Raises
    ------
    NoisyReferenceError
        Most baselines were refused as too noisy, so that there is nothing to count.
    """
    return context.once("runs of the gates", lambda: _measure(context))


def _measure(context: StudyContext) -> Outcome:
    with rendered_pool(context) as pool:
        return run_gates(pool, quick=context.quick, progress=context.progress)


def run_gates(
    pool: Pool, *, quick: bool, progress: Callable[[str, float], None], count: int = RUNS
) -> Outcome:
    """Draw runs from a pool until `count` have a baseline, and look for the smallest faults."""
    gate = gate_of(quick, pool.frames.shape[1], BATCHES_EACH * pool.batch_spp)
    rng = np.random.default_rng(SEED)
    runs: list[Run] = []
    refused = 0
    while len(runs) < count:
        progress("drawing", len(runs) / count)
        drawn = draw(pool, rng)
        source = record_of(pool, drawn.baseline)
        baseline = baseline_from_record(gate, source, "drawn")
        own = [each for each in judge(pool, gate, baseline, source) if not each.passed]
        if own:
            refused += 1
            if refused > count:
                raise NoisyReferenceError(
                    f"{refused} of {refused + len(runs)} baselines were refused, the last for: "
                    f"{next(iter(own)).message}"
                )
            continue
        verdicts = judge(pool, gate, baseline, record_of(pool, drawn.record))
        verdicts += [judge_order(pool, gate, drawn.record)]
        verdicts += [v for v in judge_equal(pool, gate, drawn) if v.kind == "equal"]
        timed = judge_time(pool, drawn)
        verdicts += [] if timed is None else [timed]
        alarms = frozenset(failed_kinds(verdicts))
        one_seed = record_of(pool, drawn.record, frame=drawn.baseline.frame)
        fixed = frozenset(failed_kinds(judge(pool, gate, baseline, one_seed)))
        runs.append(Run(drawn, baseline, alarms, fixed, timed is not None))
    smallest = {}
    for name, fault in FAULTS.items():
        progress(name, 0.0)
        smallest[name] = smallest_found(
            lambda share, fault=fault: _share_found(pool, quick, runs, fault(share)),  # type: ignore[misc]
            LARGEST[quick],
        )
    return Outcome(runs, refused, smallest)


def smallest_found(found: Callable[[float], float], largest: float) -> float:
    """Halve the range until the smallest fault that `SHARE_FOUND` of the runs find is known.

    Parameters
    ----------
    found
        Share of the runs that find a fault of a size.
    largest
        Size that all should find.

    Returns
    -------
    float
        The upper end of the last range; NaN where even the largest is not found.
    """
    if found(largest) < SHARE_FOUND:
        return float("nan")
    low, high = 0.0, largest
    while high - low > RESOLUTION:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if found(middle) >= SHARE_FOUND else (middle, high)
    return high


def _share_found(pool: Pool, quick: bool, runs: list[Run], fault: Fault) -> float:
    gate = gate_of(quick, pool.frames.shape[1], BATCHES_EACH * pool.batch_spp)
    found = 0
    for run in runs:
        record = record_of(pool, run.drawn.record, fault=fault)
        kinds = failed_kinds(judge(pool, gate, run.baseline, record))
        found += bool(kinds - set(NO_VERDICT))
    return found / max(len(runs), 1)


def share_with_interval(count: int, total: int) -> Measured:
    """Return a share and the interval of Clopper and Pearson (1934) for its probability."""
    tail = 0.5 * (1.0 - INTERVAL_LEVEL)
    low = 0.0 if count == 0 else float(betaincinv(count, total - count + 1, tail))
    high = 1.0 if count == total else float(betaincinv(count + 1, total - count, 1.0 - tail))
    return Measured(value=count / total, low=low, high=high)
