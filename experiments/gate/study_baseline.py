"""The baseline of a study's gate: its numbers as they were reviewed, one JSON file in git."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from experiments.errors import InputError
from experiments.gate.baseline import (
    BaselineMetric,
    Environment,
    environment_of,
    read_model,
)
from experiments.gate.scales import Scale, metric_from_axis
from experiments.gate.specification import Settings
from experiments.gate.study_specification import AnyStudyGate, StudyExact, StudyGate
from experiments.gate.tolerance import estimate_of
from reports.record import Interval, MetricValue
from reports.study_record import StudyRecord, StudyRow

DEFAULT_LEVEL = 0.95
"""Confidence level that a declared noise stands for."""


class StudyNumber(BaselineMetric):
    """One number of a study, and what its planted fault made of it."""

    tolerance: AnyStudyGate
    mutant: float
    """The number with the planted fault, in the same unit, when this baseline was reviewed."""


class StudyBaseline(Settings):
    """Everything that later numbers of the same study are compared with."""

    schema_version: Literal[1] = 1
    gate: str
    study: str
    quick: bool
    backend: str
    reason: str = Field(min_length=1)
    """Why these numbers are right, as given to the update."""
    created: str
    commit: str
    is_dirty: bool
    numbers: list[StudyNumber]
    environment: Environment

    def number_for(self, gate: AnyStudyGate) -> StudyNumber | None:
        """Find the stored number of a gate, by kind and check."""
        for entry in self.numbers:
            if (entry.tolerance.kind, entry.tolerance.metric) == (gate.kind, gate.metric):
                return entry
        return None


def find_row(record: StudyRecord, check: str) -> StudyRow:
    """Find a row of a study.

    Raises
    ------
    InputError
        There is none.
    """
    for row in record.rows:
        if row.check == check:
            return row
    available = "; ".join(row.check for row in record.rows)
    raise InputError(
        f"no number {check!r} was measured", f"study {record.study}", f"one of: {available}"
    )


def number_of(row: StudyRow, gate: AnyStudyGate) -> MetricValue:
    """Take a row for the number that a gate compares; the row has a value."""
    assert row.value is not None, "rows without a value are judged before"
    interval = None
    scale, noise = scale_and_noise(gate)
    if noise is None and row.low is not None and row.high is not None:
        interval = Interval(low=row.low, high=row.high)
    ideal = 0.0 if scale == "error" else 1.0
    return MetricValue(
        name=row.check,
        component=gate.component,
        value=row.value,
        interval=interval,
        formula=formula_of(row),
        # Another goal is an aim on the way there.
        ideal=row.goal if row.goal in (0.0, 1.0) else ideal,
    )


def scale_and_noise(gate: AnyStudyGate) -> tuple[Scale, float | None]:
    """Return the scale of a gate and its declared noise; an `exact` one has no noise at all."""
    return ("error", 0.0) if isinstance(gate, StudyExact) else (gate.scale, gate.noise)


def formula_of(row: StudyRow) -> str:
    """Return what must be the same for two numbers of one name to be comparable."""
    return f"{row.configuration}; {row.scene}"


def study_baseline_from(gate: StudyGate, record: StudyRecord, reason: str) -> StudyBaseline:
    """Take from a study what its gate compares; the record holds the mutants, too.

    Raises
    ------
    InputError
        A number is missing or not finite, or its scale does not fit.
    """
    return StudyBaseline(
        gate=gate.name,
        study=record.study,
        quick=record.quick,
        backend=record.machine.backend,
        reason=reason,
        created=record.created.isoformat(),
        commit=record.machine.commit,
        is_dirty=record.machine.is_dirty,
        numbers=[_study_number(each, record) for each in gate.checks],
        environment=environment_of(record.machine),
    )


def _study_number(gate: AnyStudyGate, record: StudyRecord) -> StudyNumber:
    row, mutant = find_row(record, gate.metric), find_row(record, gate.mutant)
    for each in (row, mutant):
        if each.value is None:
            raise InputError(
                "no baseline from a number that is not finite",
                f"{each.check} of study {record.study}",
                each.refused or "mend what it shows",
            )
    assert mutant.value is not None
    metric = number_of(row, gate)
    ends = [metric.value]
    if not isinstance(gate, StudyExact):
        estimate = estimate_of(gate, metric)
        ends = [metric_from_axis(gate.scale, end) for end in (estimate.low, estimate.high)]
    return StudyNumber(
        value=metric.value,
        low=min(*ends, metric.value),
        high=max(*ends, metric.value),
        level=DEFAULT_LEVEL if metric.interval is None else metric.interval.level,
        formula=metric.formula,
        tolerance=gate,
        mutant=mutant.value,
    )


def study_baseline_path(folder: Path, gate: StudyGate, backend: str) -> Path:
    """`<folder>/<gate>.study.<backend>.json`."""
    return folder / f"{gate.name}.study.{backend}.json"


def read_study_baseline(path: Path) -> StudyBaseline | None:
    """Read a baseline; None when there is no such file.

    Raises
    ------
    InputError
        When the file cannot be read or is not a baseline of this schema.
    """
    return read_model(path, StudyBaseline)
