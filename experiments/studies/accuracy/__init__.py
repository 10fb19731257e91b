"""Study "accuracy": how exact the light is that cones gather, and what each way to save costs.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations

from experiments.studies.accuracy import clipmap, presets, sparse, specular, table
from experiments.studies.check import Check

PARTS = [table.checks, clipmap.checks, sparse.checks, presets.checks, specular.checks]
"""What is measured, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
