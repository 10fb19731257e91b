"""Accuracy of the representation alone: closed rooms, form factors, leaks and the Cornell box.

All numbers are of one configuration (`thin_rays.RAYS`), so that none is bought with another.
Intervals are over phases of the grid, unless said otherwise.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from experiments.studies import closed_forms
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.closed_forms import (
    FURNACE_SCENE,
    LEAK_SCENE,
    MOST_FURNACE,
    PLACEMENTS,
    SQUARES,
    SQUARES_SCENE,
)
from experiments.studies.representation import cornell_rows, walls
from experiments.studies.representation.thin_rays import BENCH, CONFIGURATION, NAME

LEAST_FURNACE = {"axis": 0.98, "turned": 0.95}

SQUARES_WITHIN = 0.08
"""Relative error of the mean over points that squares may have."""

WALLS = {0.25: (None, 0.01), 1.0: (None, 0.002), 2.0: (0.002, 0.001), 4.0: (0.002, 0.001)}
"""Thickness of a wall in voxels: most light that may leak through, and the goal."""


def checks() -> list[Check]:
    """Return the checks of accuracy."""
    return [*cornell_rows.checks(), *_furnaces(), *_squares(), *_leaks(), *walls.checks()]


def _furnaces() -> list[Check]:
    found = []
    for placement in PLACEMENTS:
        found.append(
            Check(
                name=f"white furnace, {placement}, mean",
                configuration=CONFIGURATION,
                scene=FURNACE_SCENE,
                measure=partial(_furnace_mean, placement=placement),
                limit_low=LEAST_FURNACE[placement],
                limit_high=MOST_FURNACE,
                goal=1.0,
            )
        )
        found.append(
            Check(
                name=f"white furnace, {placement}, largest point",
                configuration=CONFIGURATION,
                scene=FURNACE_SCENE,
                measure=partial(_furnace_largest, placement=placement),
                limit_high=MOST_FURNACE,
                goal=1.0,
            )
        )
        found.append(
            Check(
                name=f"white furnace, {placement}, least point",
                configuration=CONFIGURATION,
                scene=FURNACE_SCENE,
                measure=partial(_furnace_least, placement=placement),
                goal=1.0,
            )
        )
    return found


def _furnace(context: StudyContext, placement: str) -> list[np.ndarray]:
    return closed_forms.furnace(context, BENCH, placement)[NAME]


def _furnace_mean(context: StudyContext, placement: str) -> Measured:
    return mean_of([float(each.mean()) for each in _furnace(context, placement)])


def _furnace_largest(context: StudyContext, placement: str) -> Measured:
    return Measured(value=max(float(each.max()) for each in _furnace(context, placement)))


def _furnace_least(context: StudyContext, placement: str) -> Measured:
    return Measured(value=min(float(each.min()) for each in _furnace(context, placement)))


def _squares() -> list[Check]:
    return [
        Check(
            name=f"squares, {case}, {placement}",
            configuration=CONFIGURATION,
            scene=SQUARES_SCENE,
            measure=partial(_square, case=case, placement=placement),
            limit_low=1.0 - SQUARES_WITHIN,
            limit_high=1.0 + SQUARES_WITHIN,
            goal=1.0,
        )
        for case in SQUARES
        for placement in PLACEMENTS
    ]


def _square(context: StudyContext, case: str, placement: str) -> Measured:
    return mean_of(closed_forms.squares(context, BENCH, case, placement)[NAME])


def _leaks() -> list[Check]:
    return [
        Check(
            name=f"leak, wall of {thickness:g} voxels, {placement}",
            configuration=CONFIGURATION,
            scene=LEAK_SCENE,
            measure=partial(_leak, thickness_voxels=thickness, placement=placement),
            limit_high=limit,
            goal=goal,
        )
        for thickness, (limit, goal) in WALLS.items()
        for placement in PLACEMENTS
    ]


def _leak(context: StudyContext, thickness_voxels: float, placement: str) -> Measured:
    return mean_of(closed_forms.leak(context, BENCH, thickness_voxels, placement)[NAME])
