"""Study "stability": whether stiff and extreme scenes and settings still give sound light.

A case is data (`case.py`): what must come out, why, and the numbers that say whether it did. One
loop runs them all; each family of cases has its module.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.stability import (
    bounces,
    formats,
    light,
    marches,
    placement,
    shapes,
    views,
)
from experiments.studies.stability.case import StabilityCase, checks_of_case
from experiments.studies.stability.rooms import SETTINGS

FAMILIES = {
    "light": light.cases,
    "scale and place": placement.cases,
    "marches and cones": marches.cases,
    "bounces": bounces.cases,
    "geometry": shapes.cases,
    "views and materials": views.cases,
    "storage": formats.cases,
}
"""The catalogue: what gives the cases of each family, in the order of the table."""


def catalogue() -> dict[str, list[StabilityCase]]:
    """Return all cases by family; Mitsuba's variant must be set."""
    return {family: cases() for family, cases in FAMILIES.items()}


def checks() -> list[Check]:
    """Return the checks of all cases."""
    return [
        check
        for family, cases in catalogue().items()
        for case in cases
        for check in checks_of_case(case, f"{family}: {SETTINGS}")
    ]
