"""Study "validation": what the artefact metrics themselves are worth.

Nothing is rendered. Each metric is given input whose answer is known in closed form, and its
intervals are tested by simulation. The studies of the artefacts plant the same faults in the
renderer.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.validation import bands, flickering, leaking, ledger, moving

PARTS = [
    leaking.subjects,
    moving.subjects,
    flickering.subjects,
    bands.subjects,
    ledger.subjects,
]
"""Metrics, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all metrics."""
    return [check for part in PARTS for subject in part() for check in subject.checks()]
