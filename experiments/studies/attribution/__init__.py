"""Study "attribution": which stage of the renderer owns how much of its error.

Start reading at `stages.py`: what can be made exact, and in which order. Each row is a stage's
share in one order, and the row below the last says whether the ledger closes on path tracing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from scipy.special import stdtrit

from experiments.studies.attribution.figures import DEFINITIONS as DEFINITIONS
from experiments.studies.attribution.scenes import CHOSEN, EFFORT, SCENES, Ledger, ledger_of
from experiments.studies.attribution.stages import STAGE_TITLES, STAGES
from experiments.studies.check import INTERVAL_LEVEL, Check, Measured, StudyContext
from metrics.attribution import Attribution
from metrics.confidence import Estimate

CONFIGURATION = 'preset "high", N = 64 (128 for a scene that is given), diffuse light of one bounce'

MOST_DEVIATION = 5.0
"""Standard errors by which the exact renderer may miss the reference: of batches as few as 8, one
in a thousand experiments misses by more."""

LARGEST_HALF_WIDTH = 0.02
"""Of the interval of that miss, over the energy of the reference: a ledger that closes because it
knows nothing is none.."""

IN_QUICK = ("Cornell box",)

Read = Callable[[Attribution], Estimate]


def checks() -> list[Check]:
    """Return the rows of all scenes."""
    return [check for name in SCENES for check in _rows(name)]


def _rows(name: str) -> list[Check]:
    rows = []
    for kind in ("energy", "relmse"):
        as_it_is = _row(name, f"{kind} error as it is", kind, lambda found: found.start)
        rows.append(replace(as_it_is, is_headline=True))
        if kind == "relmse":
            rows.append(_row(name, "relmse of one frame's noise", kind, lambda found: found.noise))
        for number, stage in enumerate(STAGES):
            title = STAGE_TITLES[stage]
            for order in ("forward", "backward", "interaction"):
                read = partial(_of_stage, number=number, order=order)
                rows.append(_row(name, f"{kind} owned by {title}, {order}", kind, read))
        all_exact = _row(name, f"{kind} error with all exact", kind, lambda found: found.end)
        rows.append(replace(all_exact, is_headline=True))
        rows.append(_interaction(name, kind))
        rows.append(_closing(name, kind))
    rows.append(_resolution(name))
    return rows


def _of_stage(found: Attribution, number: int, order: str) -> Estimate:
    estimate: Estimate = getattr(found.stages[number], order)
    return estimate


def _check(
    name: str,
    title: str,
    measure: Callable[[StudyContext], Measured],
    *,
    limit_high: float | None = None,
    goal: float | None = None,
) -> Check:
    scene = "corridor, or the scene of --scene" if name == CHOSEN else name
    return Check(
        name=f"{name}, {title}",
        configuration=CONFIGURATION,
        scene=scene,
        measure=measure,
        limit_high=limit_high,
        goal=goal,
        in_quick=name in IN_QUICK,
    )


def _row(name: str, title: str, kind: str, read: Read) -> Check:
    def measure(context: StudyContext) -> Measured:
        estimate = read(_kind_of(ledger_of(context, name), kind))
        return Measured(value=estimate.value, low=estimate.low, high=estimate.high)

    return _check(name, title, measure, goal=0.0)


def _interaction(name: str, kind: str) -> Check:
    def measure(context: StudyContext) -> Measured:
        return Measured(value=_kind_of(ledger_of(context, name), kind).interaction)

    return _check(name, f"{kind} that no order shares out", measure, goal=0.0)


def _closing(name: str, kind: str) -> Check:
    """Return by how many standard errors the exact renderer misses the reference."""

    def measure(context: StudyContext) -> Measured:
        end = _kind_of(ledger_of(context, name), kind).end
        return Measured(
            value=abs(end.value) / standard_error(end, EFFORT[context.quick].batch_count)
        )

    title = f"{kind} left over, standard errors"
    return _check(name, title, measure, limit_high=MOST_DEVIATION, goal=1.0)


def _resolution(name: str) -> Check:
    def measure(context: StudyContext) -> Measured:
        end = ledger_of(context, name).energy.end
        return Measured(value=0.5 * (end.high - end.low))

    title = "half width of the interval of what is left over"
    return _check(name, title, measure, limit_high=LARGEST_HALF_WIDTH, goal=0.0)


def standard_error(estimate: Estimate, batch_count: int) -> float:
    """Return the standard error behind a jackknife interval over so many batches."""
    quantile = float(stdtrit(batch_count - 1, 0.5 + 0.5 * INTERVAL_LEVEL))
    return 0.5 * (estimate.high - estimate.low) / quantile


def _kind_of(ledger: Ledger, kind: str) -> Attribution:
    found: Attribution = getattr(ledger, kind)
    return found
