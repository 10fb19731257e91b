"""One diffuse bounce in the Cornell box by thin rays, against paths at the same points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.cornell import (
    CornellBox,
    Receivers,
    cornell_box,
    exact_rays,
    path_traced,
    primary_hits,
)
from experiments.studies.exact_voxels import lay_out_window, light_exactly
from experiments.studies.phases import spread_of
from experiments.studies.representation.thin_rays import (
    CONFIGURATION,
    RAYS,
    gather,
    over_phases,
)
from vctgi.maths.cones import ring_cone_set

ENERGY = (0.98, 1.02)
LARGEST_RELMSE, GOAL_RELMSE = 0.004, 0.002
LARGEST_MRE, GOAL_MRE = 0.04, 0.03
LARGEST_SPREAD = 0.02

SCENE = "mi.cornell_box(), E / pi of one bounce at primary hits"

LIGHT_SAMPLES = (16, 4)
"""Light samples for each exact ray, in the whole study and in the quick one."""

PICTURE_EDGE = (64, 24)
"""Pixels along an edge, in the whole study and in the quick one."""

PATH_COUNT = (2048, 1024)
"""Paths a point of each half of the reference."""

RELATIVE_FLOOR = {"relMSE": 0.01, "mre": 0.1}
"""Share of the mean reference that keeps the dark finite: of its square, and of itself."""


def checks() -> list[Check]:
    """Return the checks on the Cornell box."""
    rows = [
        ("energy ratio", _energy, *ENERGY, 1.0),
        ("relMSE", _relmse, None, LARGEST_RELMSE, GOAL_RELMSE),
        ("mean relative error", _mre, None, LARGEST_MRE, GOAL_MRE),
        ("energy spread over phases", _spread, None, LARGEST_SPREAD, None),
    ]
    directions = Check(
        name="Cornell box, relMSE of the directions alone",
        configuration="256 exact rays a point along the same directions, no voxels",
        scene=SCENE,
        measure=_relmse_of_directions,
        goal=GOAL_RELMSE,
    )
    return [
        Check(
            name=f"Cornell box, {name}",
            configuration=CONFIGURATION,
            scene=SCENE,
            measure=measure,
            limit_low=low,
            limit_high=high,
            goal=goal,
        )
        for name, measure, low, high, goal in rows
    ] + [directions]


@dataclass(frozen=True)
class Comparison:
    """Incident radiance [point, rgb] by voxels, for each phase, and by paths in two halves.

    The room and the receivers are those of no offset.
    """

    room: CornellBox
    at: Receivers
    found: list[np.ndarray]
    halves: tuple[np.ndarray, np.ndarray]

    @property
    def truth(self) -> np.ndarray:
        """Mean of the halves."""
        mean: np.ndarray = 0.5 * (self.halves[0] + self.halves[1])
        return mean

    def relmse(self, found: np.ndarray) -> float:
        """Mean (V - R1)(V - R2) / (R^2 + floor): the noise of the halves has no bias in it."""
        first, second = self.halves
        scale = self.truth**2 + RELATIVE_FLOOR["relMSE"] * self.truth.mean() ** 2
        return float(np.mean((found - first) * (found - second) / scale))


def _compare(context: StudyContext) -> Comparison:
    return context.once("Cornell box", partial(_trace_both_ways, context))


def _trace_both_ways(context: StudyContext) -> Comparison:
    still = cornell_box(np.zeros(3))
    at = primary_hits(still, PICTURE_EDGE[context.quick])
    context.progress("paths", 0.0)
    first, second = (path_traced(still, at, PATH_COUNT[context.quick], seed) for seed in (1, 2))
    layout = lay_out_window(still.triangles)

    def at_phase(phase: np.ndarray) -> np.ndarray:
        offset = phase * layout.finest_voxel_size
        room = cornell_box(offset)
        volume = light_exactly(room.scene, layout, room.radiance)
        return gather(volume, room.scene, at.points + offset, at.normals)

    return Comparison(still, at, over_phases(context, at_phase), (first, second))


def _energies(context: StudyContext) -> list[float]:
    both = _compare(context)
    return [float(each.mean() / both.truth.mean()) for each in both.found]


def _energy(context: StudyContext) -> Measured:
    return mean_of(_energies(context))


def _spread(context: StudyContext) -> Measured:
    return spread_of(_energies(context))


def _relmse(context: StudyContext) -> Measured:
    both = _compare(context)
    return mean_of([both.relmse(found) for found in both.found])


def _relmse_of_directions(context: StudyContext) -> Measured:
    both = _compare(context)
    cones = ring_cone_set(RAYS.cone_count)
    found = exact_rays(both.room, both.at, cones, LIGHT_SAMPLES[context.quick])
    return Measured(value=both.relmse(found))


def _mre(context: StudyContext) -> Measured:
    """Mean |V - R| / (R + floor); it keeps what noise the reference has."""
    truth = _compare(context).truth
    scale = truth + RELATIVE_FLOOR["mre"] * truth.mean()
    return mean_of([float(np.mean(np.abs(v - truth) / scale)) for v in _compare(context).found])
