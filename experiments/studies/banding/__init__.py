"""Study "banding": how much of a glossy picture is owed to where marches happen to sample."""

from __future__ import annotations

from experiments.studies.banding import chosen_scene, sweeps
from experiments.studies.banding.definitions import DEFINITIONS as DEFINITIONS
from experiments.studies.check import Check

PARTS = [chosen_scene.checks, sweeps.checks]
"""What is measured, in the order of the table: a scene without bands is refused at once."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
