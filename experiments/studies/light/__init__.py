"""Study "light": whether the power of every light arrives in the voxels, in the right place.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.light import maps

PARTS = [maps.checks]
"""What is measured, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
