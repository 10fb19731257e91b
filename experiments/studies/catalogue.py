"""The studies by name. Nothing is imported before it is asked for: some import Mitsuba."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Protocol, cast

from experiments.errors import InputError
from experiments.studies.check import Check
from reports.study_figures import Definition


class StudyModule(Protocol):
    """What the module of a study holds."""

    def checks(self) -> list[Check]:
        """Return all that the study would measure, in the order of its table."""


@dataclass(frozen=True)
class StudyEntry:
    """One study: where it is, and its question."""

    module: str
    title: str


STUDIES = {
    "representation": StudyEntry(
        "experiments.studies.representation",
        "How exact are the voxels themselves, without cones or light maps to blame?",
    ),
    "light": StudyEntry(
        "experiments.studies.light",
        "Does the power of every light arrive in the voxels, in the right place?",
    ),
    "peers": StudyEntry(
        "experiments.studies.peers",
        "What do the recipes of other systems make of the same voxels?",
    ),
    "accuracy": StudyEntry(
        "experiments.studies.accuracy",
        "How exact is light by cones, with one configuration for all scenes?",
    ),
    "attribution": StudyEntry(
        "experiments.studies.attribution",
        "Which stage owns how much of the error, and does the ledger close?",
    ),
    "leaking": StudyEntry(
        "experiments.studies.leaking",
        "How much of the light came through walls, or from the wrong side of them?",
    ),
    "banding": StudyEntry(
        "experiments.studies.banding",
        "How much of a glossy picture is owed to where marches happen to sample?",
    ),
    "aliasing": StudyEntry(
        "experiments.studies.aliasing",
        "Does light flow from voxel to voxel as smoothly as what sends it moves?",
    ),
    "flicker": StudyEntry(
        "experiments.studies.flicker",
        "Does the light of surfaces hold still while the eye moves?",
    ),
    "pareto": StudyEntry(
        "experiments.studies.pareto",
        "How much error is left for how much time, by cones, by paths, by denoised paths?",
    ),
    "growth": StudyEntry(
        "experiments.studies.growth",
        "How do time, counts and memory grow with pixels, cones, voxels, triangles and lights?",
    ),
    "speed": StudyEntry(
        "experiments.studies.speed",
        "Are cones faster than paths that are as exact, and do they read at full rate?",
    ),
    "stability": StudyEntry(
        "experiments.studies.stability",
        "Do stiff and extreme scenes and settings still give sound light?",
    ),
    "elimination": StudyEntry(
        "experiments.studies.elimination",
        "What is saved by leaving out what a scene does not need, and what does it change?",
    ),
    "gates": StudyEntry(
        "experiments.studies.gates",
        "How often do gates fail for nothing, and how small a fault do they find?",
    ),
    "validation": StudyEntry(
        "experiments.studies.validation",
        "Do the metrics of artefacts find what is there, and nothing else?",
    ),
    "fitted": StudyEntry(
        "experiments.studies.fitted",
        "What are fitted presets worth, and what bounds any fit?",
    ),
    "derivatives": StudyEntry(
        "experiments.studies.derivatives",
        "Are the picture's derivatives those of differences, and what do they cost?",
    ),
}
"""Studies by name."""


def find_study(name: str) -> StudyEntry:
    """Return a study.

    Raises
    ------
    InputError
        No study of that name.
    """
    if name not in STUDIES:
        raise InputError(
            what=f"no study '{name}'", where="the command line", remedy=f"use {', '.join(STUDIES)}"
        )
    return STUDIES[name]


def checks_of(entry: StudyEntry) -> list[Check]:
    """Return the checks of a study; Mitsuba's variant must be set."""
    module = cast(StudyModule, import_module(entry.module))
    found = module.checks()
    names = [check.name for check in found]
    repeated = {name for name in names if names.count(name) > 1}
    assert not repeated, f"{entry.module}: checks of one name: {sorted(repeated)}"
    return found


def definitions_of(entry: StudyEntry) -> list[Definition]:
    """Return what the numbers of a study are, where its module says so in ``DEFINITIONS``."""
    return list(getattr(import_module(entry.module), "DEFINITIONS", ()))


def select_checks(found: list[Check], only: str | None, *, quick: bool = False) -> list[Check]:
    """Return the checks whose name holds `only`; a whole name selects that one alone.

    The quick version leaves some out, unless they are asked for by name.

    Raises
    ------
    InputError
        None does.
    """
    if only is None:
        return [check for check in found if check.in_quick or not quick]
    wanted = only.casefold()
    exact = [check for check in found if check.name.casefold() == wanted]
    chosen = exact or [check for check in found if wanted in check.name.casefold()]
    if not chosen:
        names = "; ".join(check.name for check in found)
        raise InputError(what=f"no check holds '{only}'", where="--only", remedy=f"one of: {names}")
    return chosen
