"""The file that a study writes: one row for each number that it checks.

A report reads it from here, without anything that renders.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, Literal

from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    model_validator,
)

from reports.model_file import read_model
from reports.schema import Machine
from reports.study_figures import Definition, Figure

STUDY_SCHEMA_VERSION: Final = 1
"""Raised by one whenever a reader of the old form would misread the new one."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class StudyRow(_Part):
    """One number of a study, with what was asked of it."""

    check: str
    """What was measured; unique within the study."""
    configuration: str
    scene: str
    value: float | None
    """None where the measurement gave no finite number; such a row has not passed."""
    low: float | None = None
    high: float | None = None
    """95 % confidence interval of the value, or None where it has none."""
    limit_low: float | None = None
    limit_high: float | None = None
    """What the value must keep to, ends included; None where nothing is asked."""
    goal: float | None = None
    """What one would like to see; it decides nothing."""
    passed: bool
    refused: str = ""
    """Why nothing was measured, such as a reference that is too noisy for it; else empty."""
    note: str = ""
    """What a reader must know about this value, such as that it is a bound."""
    how: str
    """The command that gives this one number."""

    @model_validator(mode="after")
    def _consistent(self) -> StudyRow:
        if (self.low is None) != (self.high is None):
            raise ValueError(f"row {self.check!r}: an interval has two ends or none")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"row {self.check!r}: low {self.low} must not exceed high {self.high}")
        if self.refused and self.value is not None:
            raise ValueError(f"row {self.check!r}: a number that was refused has no value")
        kept = is_within(self.value, self.limit_low, self.limit_high)
        if self.passed != kept:
            raise ValueError(f"row {self.check!r}: passed is {self.passed}, its limits say {kept}")
        return self


class StudyRecord(_Part):
    """One run of a study."""

    schema_version: Literal[1] = STUDY_SCHEMA_VERSION
    study: str
    quick: bool
    """Whether this was the smaller version of the study."""
    created: AwareDatetime
    command: str
    """What to type to make this file again."""
    rows: list[StudyRow] = Field(min_length=1)
    machine: Machine
    question: str = ""
    """What the study asks."""
    code: str = ""
    """Hash of the sources that the numbers and figures come from."""
    headlines: list[str] = []
    """Checks that are read first."""
    figures: list[Figure] = []
    definitions: list[Definition] = []

    @model_validator(mode="after")
    def _unique_figures(self) -> StudyRecord:
        keys = [figure.key for figure in self.figures]
        repeated = sorted({key for key in keys if keys.count(key) > 1})
        if repeated:
            raise ValueError(f"figures of one name: {', '.join(repeated)}")
        return self


def is_within(value: float | None, low: float | None, high: float | None) -> bool:
    """Whether a number is finite and keeps to its limits, of which either may be missing."""
    if value is None or not math.isfinite(value):
        return False
    return (low is None or value >= low) and (high is None or value <= high)


def record_text(record: StudyRecord) -> str:
    """Return what the file of a record holds."""
    return record.model_dump_json(indent=1) + "\n"


def read_study(path: Path) -> StudyRecord:
    """Read the file of a study.

    Raises
    ------
    ValueError
        When the file is missing or is not the record of a study.
    """
    return read_model(
        path, StudyRecord, noun="study", kind="study", command="vctgi study NAME --json FILE"
    )
