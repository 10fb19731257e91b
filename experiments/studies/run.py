"""Running the checks of a study: each number is yielded as soon as it is known."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.ledger import Ledger
from reference import NoisyReferenceError
from reports.study_record import StudyRow, is_within


def run_checks(
    study: str, chosen: list[Check], context: StudyContext, ledger: Ledger, *, resume: bool
) -> Iterator[StudyRow]:
    """Measure checks one after the other.

    Parameters
    ----------
    study
        Name and options of the study, for the command that a row names.
    chosen
        What to measure.
    context
        Handed to each measurement.
    ledger
        Where finished numbers are kept.
    resume
        Whether numbers that are in the ledger are taken from it.
    """
    for check in chosen:
        kept = ledger.find(check) if resume else None
        if kept is not None:
            yield make_row(study, check, kept)
            continue
        yield measured_row(study, check, context, ledger.add)


def measured_row(
    study: str,
    check: Check,
    context: StudyContext,
    keep: Callable[[Check, Measured], None] = lambda _check, _found: None,
) -> StudyRow:
    """Measure a check and return its row; a comparison below the noise gives a row that says so.

    Parameters
    ----------
    study, check, context
        As for `run_checks`.
    keep
        Told of a number that was measured.
    """
    try:
        found = check.measure(context)
    except NoisyReferenceError as error:
        row = make_row(study, check, Measured(value=math.nan))
        return row.model_copy(update={"refused": " ".join(str(error).split())})
    keep(check, found)
    return make_row(study, check, found)


def make_row(study: str, check: Check, measured: Measured) -> StudyRow:
    """Return the row of a measured check."""
    is_number = math.isfinite(measured.value)
    return StudyRow(
        check=check.name,
        configuration=check.configuration,
        scene=check.scene,
        value=measured.value if is_number else None,
        low=measured.low if is_number else None,
        high=measured.high if is_number else None,
        limit_low=check.limit_low,
        limit_high=check.limit_high,
        goal=check.goal,
        passed=is_within(measured.value, check.limit_low, check.limit_high),
        how=f"vctgi study {study} --only {shlex.quote(check.name)}",
    )
