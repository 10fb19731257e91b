"""Planted faults in the numbers of a study: each check of its gate must fail for its mutant."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

from experiments.errors import InputError
from experiments.gate.fault import Fault
from experiments.gate.scales import metric_from_axis
from experiments.gate.study_baseline import StudyBaseline, find_row, scale_and_noise
from experiments.gate.study_evaluation import evaluate_study
from experiments.gate.study_specification import AnyStudyGate, StudyExact, StudyGate
from experiments.gate.tolerance import effect_on_axis
from reports.junit import Verdict
from reports.study_record import StudyRecord, StudyRow


@dataclass(frozen=True)
class StudyMutant(Fault):
    """A study with one fault."""

    record: StudyRecord


def check_study_mutants(
    record: StudyRecord, gate: StudyGate, baseline: StudyBaseline
) -> list[Verdict]:
    """Plant every mutant of a study's gate and demand that the right check fails.

    Parameters
    ----------
    record
        Good numbers, and those of the checks that measure them with a planted fault.
    gate, baseline
        What it is held to.

    Returns
    -------
    list of Verdict
        One of kind `mutant` per fault; failed when the fault went unnoticed.
    """
    verdicts = []
    for mutant in planted_in_study(record, gate, baseline):
        start = time.perf_counter()
        found = evaluate_study(mutant.record, gate, baseline)
        seconds = time.perf_counter() - start
        verdicts.append(mutant.judge(gate.name, gate.scene, found, seconds))
    return verdicts


def planted_in_study(
    record: StudyRecord, gate: StudyGate, baseline: StudyBaseline
) -> Iterator[StudyMutant]:
    """Make the mutants of a study's gate, one fault each.

    One NaN; another configuration; for each check its number moved by the weakest effect, ratios
    up and down, and its number as the planted fault makes it, measured anew; the two numbers of
    each order swapped.

    Raises
    ------
    InputError
        The record lacks a number.
    """
    first = gate.checks[0]
    nan = find_row(record, first.metric).model_copy(
        update={"value": None, "low": None, "high": None, "passed": False}
    )
    yield StudyMutant(f"one NaN in {first.metric}", "finite", "numbers", _with(record, nan))
    other = find_row(record, first.metric).model_copy(update={"configuration": "mutant"})
    yield StudyMutant("other configuration", "exact", first.metric, _with(record, other))
    for each in gate.checks:
        row = find_row(record, each.metric)
        for sign in (1, -1) if scale_and_noise(each)[0] == "ratio" else (1,):
            moved = _moved(row, _by_weakest_effect(each, baseline, sign))
            name = f"{each.metric} moved {'up' if sign > 0 else 'down'} [{each.kind}]"
            yield StudyMutant(name, each.kind, each.metric, _with(record, moved))
        planted = find_row(record, each.mutant)
        if planted.value is None:
            raise InputError("the planted fault gave no number", each.mutant, "name another check")
        faulty = row.model_copy(
            update={"value": planted.value, "low": planted.low, "high": planted.high}
        )
        name = f"{each.metric} with its fault: {each.mutant} [{each.kind}]"
        yield StudyMutant(name, each.kind, each.metric, _with(record, faulty))
    for order in gate.orders:
        better, worse = (find_row(record, name) for name in (order.better, order.worse))
        swapped = (
            row.model_copy(update={"value": by.value, "low": by.low, "high": by.high})
            for row, by in ((better, worse), (worse, better))
        )
        item = f"order {order.name}"
        yield StudyMutant(f"{item} swapped", "order", item, _with(record, *swapped))


def _by_weakest_effect(gate: AnyStudyGate, baseline: StudyBaseline, sign: int) -> float:
    """Return the baseline's number moved by the weakest fault that its gate must catch."""
    entry = baseline.number_for(gate)
    if entry is None:
        raise InputError("the baseline has no number", gate.metric, "review a new one")
    if isinstance(gate, StudyExact):
        return math.nextafter(entry.value, math.inf)
    before = entry.estimate()
    return metric_from_axis(gate.scale, before.value + sign * effect_on_axis(gate, before))


def _moved(row: StudyRow, value: float) -> StudyRow:
    """Return a row with another number; its interval moves along."""
    assert row.value is not None, "rows without a value are judged before"
    update: dict[str, float] = {"value": value}
    if row.low is not None and row.high is not None:
        distance = value - row.value
        update |= {"low": row.low + distance, "high": row.high + distance}
    return row.model_copy(update=update)


def _with(record: StudyRecord, *rows: StudyRow) -> StudyRecord:
    """Return a study with some rows replaced."""
    new = {row.check: row for row in rows}
    return record.model_copy(update={"rows": [new.get(row.check, row) for row in record.rows]})
