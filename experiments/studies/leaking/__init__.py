"""Study "leaking": how much of the light came through walls, or from the wrong side of them.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.leaking import control, faults, pictures, rooms
from experiments.studies.leaking.definitions import DEFINITIONS as DEFINITIONS

PARTS = [rooms.checks, pictures.checks, control.checks, faults.checks]
"""What is measured, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
