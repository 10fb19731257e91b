"""Measure how the power of every light arrives in the voxels, and what becomes of it.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.light import (
    bounces,
    emitter_pictures,
    form_factors,
    injection,
    maps,
    sky,
)

PARTS = [
    maps.checks,
    emitter_pictures.checks,
    injection.checks,
    bounces.checks,
    form_factors.checks,
    sky.checks,
]
"""What is measured, in the order of the table."""


def checks() -> list[Check]:
    """Return the checks of all parts."""
    return [check for part in PARTS for check in part()]
