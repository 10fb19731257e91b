"""What tracers make of scenes of which the light is known: furnace, squares, divided rooms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from experiments.studies import scenes
from experiments.studies.check import StudyContext
from experiments.studies.tracers import Bench, ByTracer, incident_in

PLACEMENTS = {"axis": False, "turned": True}
"""Whether the scene is turned by 33 degrees about (1, 2, 3) against the lattice."""

MOST_FURNACE = 1.001
"""A closed box of one radiance cannot gain light; rounding can."""

FURNACE_SCENE = "closed box of radiance 1, two wide"
SQUARES_SCENE = "two unit squares, received over closed form"
LEAK_SCENE = "lit and dark closed rooms, unit cubes side by side"

FURNACE_EDGE, SQUARE_EDGE, LEAK_EDGE = (12, 5), (24, 12), (8, 4)
"""Receivers along an edge of a surface, in a whole study and in a quick one."""

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


def furnace(context: StudyContext, bench: Bench, placement: str) -> ByTracer:
    """E / pi [point] on the faces of a closed box of radiance 1, where the truth is 1."""
    scene = _placed(scenes.white_furnace(FURNACE_EDGE[context.quick], seed=1), placement)
    return incident_in(context, bench, f"furnace, {placement}", scene)


def squares(
    context: StudyContext, bench: Bench, case: str, placement: str
) -> dict[str, list[float]]:
    """Mean over the receiving square over its closed form, at each phase."""
    scene = _placed(SQUARES[case](SQUARE_EDGE[context.quick], 2), placement)
    found = incident_in(context, bench, f"squares, {case}, {placement}", scene)
    return {
        name: [float(each.mean()) / FORM_FACTORS[case] for each in phases]
        for name, phases in found.items()
    }


def leak(
    context: StudyContext, bench: Bench, thickness_voxels: float, placement: str
) -> dict[str, list[float]]:
    """Mean light in the dark room over the radiance of the lit one's walls, at each phase.

    Parameters
    ----------
    context, bench
        As elsewhere.
    thickness_voxels
        Of the wall between them, in voxels of the finest level.
    placement
        One of `PLACEMENTS`.
    """
    edge = LEAK_EDGE[context.quick]

    def rooms(thickness: float) -> scenes.ShiningScene:
        return _placed(scenes.divided_rooms(thickness, edge, seed=3), placement)

    voxel_size = bench.layout(context, rooms(0.0).triangles).finest_voxel_size
    scene = rooms(thickness_voxels * voxel_size)
    found = incident_in(context, bench, f"leak, {thickness_voxels}, {placement}", scene)
    return {name: [float(each.mean()) for each in phases] for name, phases in found.items()}


def _placed(scene: scenes.ShiningScene, placement: str) -> scenes.ShiningScene:
    return scene.turned() if PLACEMENTS[placement] else scene
