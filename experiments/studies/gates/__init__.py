"""Study "gates": how often gates fail for nothing, and how small a fault they find.

The reference and the cones of the Cornell box are rendered once, as `BATCHES` batches of paths and
`FRAMES` frames of cones, each with random numbers of its own (`pool.py`). A run draws, without
replacement, eight batches, a frame and three times of a stage for the baseline, and as many others
for the record (`draws.py`), makes both as `vctgi gate` does, and asks the same code for verdicts.
Runs share batches with other runs, so that the intervals, which count them as independent, are a
little too narrow.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.gates.alarms import (
    FAULTS,
    NO_VERDICT,
    RUNS,
    Outcome,
    Run,
    outcome,
    share_with_interval,
)
from experiments.studies.gates.pool import PRESET
from reports.study_figures import Definition

MOST_ALARMS = 0.01
"""Share of false alarms that is allowed."""

WEAKEST_MUTANT = 0.05
"""Change of energy that a gate must find, and that the quick version has four times as large."""

KINDS = ("finite", "exact", "absolute", "noninferior", "equal", "order", "budget")
"""Kinds of gate that are counted; a noisy reference gives no verdict, which is counted apart."""

CONFIGURATION = f'preset "{PRESET}", gates of tests/gates, one metric of each other kind'
SCENE = "cornell_box, 64 x 64 (32 x 32 quick)"

DEFINITIONS = (
    Definition(
        name="false alarms",
        formula="runs in which a check of the kind fails / runs; interval of Clopper and Pearson",
        source="experiments/studies/gates/alarms.py",
    ),
    Definition(
        name="smallest regression found",
        formula="smallest change of the indirect light's energy that fails 95 % of the runs",
        source="experiments/studies/gates/alarms.py, smallest_found",
    ),
)


def checks() -> list[Check]:
    """Return the checks of the gates."""
    shares: list[tuple[str, Callable[[Run], bool], float | None]] = [
        (f"false alarms, {kind}", partial(_has_failed, kind=kind), MOST_ALARMS) for kind in KINDS
    ]
    shares.append(("false alarms, any kind", _has_any_failed, MOST_ALARMS))
    shares.append(("false alarms, any kind, cones of one seed", _has_fixed_failed, MOST_ALARMS))
    shares.append(("runs without a verdict", _has_no_verdict, MOST_ALARMS))
    found = [
        _check(name, partial(_share, condition=condition), limit, is_headline="any" in name)
        for name, condition, limit in shares
    ]
    found.append(_check("baselines refused as too noisy", _refused, None, is_headline=False))
    found.append(_check("times refused as too noisy", _untimed, None, is_headline=False))
    found += [
        _check(
            f"smallest regression found, {name}",
            partial(_smallest, name=name),
            None if name == "leaked light" else 4.0 * WEAKEST_MUTANT,
            is_headline=True,
        )
        for name in FAULTS
    ]
    return found


def _check(
    name: str,
    measure: Callable[[Outcome], Measured],
    limit: float | None,
    *,
    is_headline: bool,
) -> Check:
    return Check(
        name=name,
        configuration=CONFIGURATION,
        scene=f"{SCENE}, {RUNS} runs",
        measure=lambda context: _of(context, measure),
        limit_high=limit,
        goal=0.0,
        is_headline=is_headline,
    )


def _of(context: StudyContext, measure: Callable[[Outcome], Measured]) -> Measured:
    return measure(outcome(context))


def _share(found: Outcome, condition: Callable[[Run], bool]) -> Measured:
    return share_with_interval(sum(map(condition, found.runs)), len(found.runs))


def _refused(found: Outcome) -> Measured:
    return share_with_interval(found.refused, found.refused + len(found.runs))


def _untimed(found: Outcome) -> Measured:
    return share_with_interval(sum(not run.is_timed for run in found.runs), len(found.runs))


def _smallest(found: Outcome, name: str) -> Measured:
    return Measured(value=found.smallest[name])


def _has_failed(run: Run, kind: str) -> bool:
    return kind in run.alarms


def _has_any_failed(run: Run) -> bool:
    return bool(run.alarms - set(NO_VERDICT))


def _has_fixed_failed(run: Run) -> bool:
    return bool(run.fixed_alarms - set(NO_VERDICT))


def _has_no_verdict(run: Run) -> bool:
    return bool(run.alarms & set(NO_VERDICT))
