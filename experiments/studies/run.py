"""Running the checks of a study: each number is yielded as soon as it is known."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator

from experiments.studies.check import Check, Measured, RefusedError, StudyContext
from experiments.studies.ledger import Ledger
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
        measured = ledger.find(check) if resume else None
        if measured is None:
            try:
                measured = check.measure(context)
            except RefusedError as error:
                yield make_row(study, check, Measured(value=math.nan), refused=str(error))
                continue
            ledger.add(check, measured)
        yield make_row(study, check, measured)


def make_row(study: str, check: Check, measured: Measured, refused: str = "") -> StudyRow:
    """Return the row of a check that was measured, or was refused for a reason."""
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
        refused=refused,
        note=measured.note,
        how=f"vctgi study {study} --only {shlex.quote(check.name)}",
    )
