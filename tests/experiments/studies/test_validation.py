"""Study "validation": what needs no draws keeps to its limits, and intervals of a few metrics."""

from __future__ import annotations

import pytest

from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.check import Check, StudyContext
from reports.study_record import is_within

CHECKS = checks_of(find_study("validation"))

NEEDS_DRAWS = ("coverage", "mean shift")

DRAWN = (
    # Of each kind of interval one: a ratio, a root, a share, a distance over tiles.
    "L2 missing light: Gaussian noise of 10 %, coverage of intervals",
    "voxel period, RMS: Gaussian noise of 10 %, coverage of intervals",
    "voxel period, share of energy: gamma noise of 50 %, coverage of intervals",
    "L3 over-occlusion: gamma noise of 50 %, coverage of intervals",
)
"""Rows that failed before the noise of the mean light, of energies and of the gain were seen to."""


def measured_within(check: Check) -> bool:
    context = StudyContext(quick=True, progress=lambda _step, _share: None)
    found = check.measure(context)
    return is_within(found.value, check.limit_low, check.limit_high)


def test_every_metric_has_every_row() -> None:
    names = {check.name.split(":")[0] for check in CHECKS}
    for name in names:
        rows = [check.name for check in CHECKS if check.name.startswith(f"{name}:")]
        for question in ("closed form", "monotone", "one NaN"):
            assert sum(question in row for row in rows) == 1, (name, question)
        assert sum("planted fault" in row for row in rows) >= 2, name


@pytest.mark.parametrize(
    "check",
    [check for check in CHECKS if not any(words in check.name for words in NEEDS_DRAWS)],
    ids=lambda check: check.name,
)
def test_rows_without_draws(check: Check) -> None:
    assert measured_within(check)


@pytest.mark.parametrize("name", DRAWN)
def test_rows_with_draws(name: str) -> None:
    (check,) = [check for check in CHECKS if check.name == name]
    assert measured_within(check)
