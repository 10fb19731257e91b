"""Study "stability": whether stiff and extreme scenes and settings still give sound light.

A case is data (`case.py`): what must come out, why, and the numbers that say whether it did. One
loop runs them all; each family of cases has its module.
"""

from __future__ import annotations

from dataclasses import replace

from experiments.studies.check import Check
from experiments.studies.stability import (
    back_ends,
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
from reports.study_figures import Definition

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


HEADLINES = (
    "lamp 1e+08 times as bright, condition number",
    "room scaled by 1e+06, mean difference",
    "room 100000 times its size away, energy",
    "fog of opacity 1 a voxel, error",
    "fog by a step of a thousandth of a voxel, error",
    "24 scatterings at albedo 1, growth factor",
    "wall of 0.05 voxels, in level 0, light in the dark room",
    "floor with slivers of aspect 1e6, mean difference",
    "camera exactly on a wall, energy",
    "srgb8, lamp 1e+08 times as bright, mean difference",
    "float16, light above 65504, refused in one line",
)
"""Numbers that are read first, one or two of each family."""


DEFINITIONS = [
    Definition(
        name="mean difference",
        formula="mean |picture - truth| / mean truth",
        source="experiments/studies/stability/case.py",
    ),
    Definition(
        name="condition number",
        formula="relative change of the light over that of the input which caused it",
        source="experiments/studies/stability/light.py",
    ),
    Definition(
        name="growth factor",
        formula="largest flux of a scattering over that of the one before it",
        source="experiments/studies/stability/bounces.py",
    ),
    Definition(
        name="values that are NaN, infinite or negative",
        formula="count over all pictures of a case",
        source="experiments/studies/stability/case.py",
    ),
]


def catalogue() -> dict[str, list[StabilityCase]]:
    """Return all cases by family; Mitsuba's variant must be set."""
    found = {family: cases() for family, cases in FAMILIES.items()}
    if back_ends.can_compare():
        found["back ends"] = back_ends.cases(find_case)
    return found


def find_case(name: str) -> StabilityCase:
    """Return a case by its name."""
    (found,) = [case for cases in FAMILIES.values() for case in cases() if case.name == name]
    return found


def checks() -> list[Check]:
    """Return the checks of all cases."""
    return [
        replace(check, is_headline=check.name in HEADLINES)
        for family, cases in catalogue().items()
        for case in cases
        for check in checks_of_case(case, f"{family}: {SETTINGS}")
    ]
