"""Study "accuracy": what cones make of exact voxels, one configuration for all numbers of a column.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations

from experiments.studies.accuracy import clipmap, table
from experiments.studies.check import Check

PARTS = [table.checks, clipmap.checks]
"""What is measured, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
