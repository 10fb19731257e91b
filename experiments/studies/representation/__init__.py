"""Study "representation": the voxels as a picture of the scene, apart from cones and light maps.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.representation import accuracy, formats, memory, speed

PARTS = [accuracy.checks, formats.checks, speed.checks, memory.checks]
"""What is measured, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
