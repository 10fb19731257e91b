"""Accuracy of the representation alone: closed rooms, form factors, leaks and the Cornell box.

All numbers are of one configuration (`thin_rays.RAYS`), so that none is bought with another.
Intervals are over phases of the grid, unless said otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from experiments.studies import scenes
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.exact_voxels import lay_out_window
from experiments.studies.representation import cornell_rows, walls
from experiments.studies.representation.thin_rays import CONFIGURATION, incident_in

PLACEMENTS = {"axis": False, "turned": True}
"""Whether the scene is turned by 33 degrees about (1, 2, 3) against the lattice."""

LEAST_FURNACE = {"axis": 0.98, "turned": 0.95}
MOST_FURNACE = 1.001
"""A closed box of one radiance cannot gain light; rounding can."""

SQUARES_WITHIN = 0.08
"""Relative error of the mean over points that squares may have."""

WALLS = {0.25: (None, 0.01), 1.0: (None, 0.002), 2.0: (0.002, 0.001), 4.0: (0.002, 0.001)}
"""Thickness of a wall in voxels: most light that may leak through, and the goal."""

FURNACE_EDGE, SQUARE_EDGE, LEAK_EDGE = (12, 5), (24, 12), (8, 4)
"""Receivers along an edge of a surface, in the whole study and in the quick one."""


def checks() -> list[Check]:
    """Return the checks of accuracy."""
    return [*cornell_rows.checks(), *_furnaces(), *_squares(), *_leaks(), *walls.checks()]


def _furnaces() -> list[Check]:
    scene = "closed box of radiance 1, two wide"
    found = []
    for placement in PLACEMENTS:
        found.append(
            Check(
                name=f"white furnace, {placement}, mean",
                configuration=CONFIGURATION,
                scene=scene,
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
                scene=scene,
                measure=partial(_furnace_largest, placement=placement),
                limit_high=MOST_FURNACE,
                goal=1.0,
            )
        )
        found.append(
            Check(
                name=f"white furnace, {placement}, least point",
                configuration=CONFIGURATION,
                scene=scene,
                measure=partial(_furnace_least, placement=placement),
                goal=1.0,
            )
        )
    return found


def _furnace(context: StudyContext, placement: str) -> list[np.ndarray]:
    scene = _placed(scenes.white_furnace(FURNACE_EDGE[context.quick], seed=1), placement)
    return incident_in(context, f"furnace, {placement}", scene)


def _furnace_mean(context: StudyContext, placement: str) -> Measured:
    return mean_of([float(each.mean()) for each in _furnace(context, placement)])


def _furnace_largest(context: StudyContext, placement: str) -> Measured:
    return Measured(value=max(float(each.max()) for each in _furnace(context, placement)))


def _furnace_least(context: StudyContext, placement: str) -> Measured:
    return Measured(value=min(float(each.min()) for each in _furnace(context, placement)))


SQUARES: dict[str, Callable[[int, int], scenes.ShiningScene]] = {
    "parallel at 0.25": partial(scenes.parallel_squares, 0.25),
    "parallel at 1": partial(scenes.parallel_squares, 1.0),
    "perpendicular": scenes.perpendicular_squares,
}
"""Pairs of unit squares, the first of which shines."""

FORM_FACTORS = {
    "parallel at 0.25": scenes.parallel_form_factor(0.25),
    "parallel at 1": scenes.parallel_form_factor(1.0),
    "perpendicular": scenes.perpendicular_form_factor(),
}
"""What the second one receives, in closed form."""


def _squares() -> list[Check]:
    return [
        Check(
            name=f"squares, {case}, {placement}",
            configuration=CONFIGURATION,
            scene="two unit squares, received over closed form",
            measure=partial(_square, case=case, placement=placement),
            limit_low=1.0 - SQUARES_WITHIN,
            limit_high=1.0 + SQUARES_WITHIN,
            goal=1.0,
        )
        for case in SQUARES
        for placement in PLACEMENTS
    ]


def _square(context: StudyContext, case: str, placement: str) -> Measured:
    scene = _placed(SQUARES[case](SQUARE_EDGE[context.quick], 2), placement)
    found = incident_in(context, f"squares, {case}, {placement}", scene)
    return mean_of([float(each.mean()) / FORM_FACTORS[case] for each in found])


def _leaks() -> list[Check]:
    return [
        Check(
            name=f"leak, wall of {thickness:g} voxels, {placement}",
            configuration=CONFIGURATION,
            scene="lit and dark closed rooms, unit cubes side by side",
            measure=partial(_leak, thickness_voxels=thickness, placement=placement),
            limit_high=limit,
            goal=goal,
        )
        for thickness, (limit, goal) in WALLS.items()
        for placement in PLACEMENTS
    ]


def _leak(context: StudyContext, thickness_voxels: float, placement: str) -> Measured:
    edge = LEAK_EDGE[context.quick]

    def rooms(thickness: float) -> scenes.ShiningScene:
        return _placed(scenes.divided_rooms(thickness, edge, seed=3), placement)

    voxel_size = lay_out_window(rooms(0.0).triangles).finest_voxel_size
    scene = rooms(thickness_voxels * voxel_size)
    found = incident_in(context, f"leak, {thickness_voxels}, {placement}", scene)
    return mean_of([float(each.mean()) for each in found])


def _placed(scene: scenes.ShiningScene, placement: str) -> scenes.ShiningScene:
    return scene.turned() if PLACEMENTS[placement] else scene
