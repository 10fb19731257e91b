"""Study "peers": recipes of other systems under one voxel field, ours beside them.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.peers import cone_sets, rooms, walls

PARTS = [cone_sets.checks, walls.checks, rooms.checks]
"""What is measured, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
