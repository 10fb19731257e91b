"""One diffuse bounce in the Cornell box by thin rays, against paths at the same points."""

from __future__ import annotations

from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.cornell import exact_rays
from experiments.studies.cornell_truth import SCENE, CornellTruth, cornell_truth, scores
from experiments.studies.phases import spread_of
from experiments.studies.representation.thin_rays import BENCH, CONFIGURATION, NAME, RAYS
from vctgi.maths.cones import ring_cone_set

ENERGY = (0.98, 1.02)
LARGEST_RELMSE, GOAL_RELMSE = 0.004, 0.002
LARGEST_MRE, GOAL_MRE = 0.04, 0.03
LARGEST_SPREAD = 0.02

LIGHT_SAMPLES = (16, 4)
"""Light samples for each exact ray, in the whole study and in the quick one."""


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


def _energy(context: StudyContext) -> Measured:
    return mean_of(scores(context, BENCH, NAME, CornellTruth.energy))


def _spread(context: StudyContext) -> Measured:
    return spread_of(scores(context, BENCH, NAME, CornellTruth.energy))


def _relmse(context: StudyContext) -> Measured:
    return mean_of(scores(context, BENCH, NAME, CornellTruth.relmse))


def _mre(context: StudyContext) -> Measured:
    return mean_of(scores(context, BENCH, NAME, CornellTruth.mre))


def _relmse_of_directions(context: StudyContext) -> Measured:
    truth = cornell_truth(context)
    cones = ring_cone_set(RAYS.cone_count)
    found = exact_rays(truth.room, truth.at, cones, LIGHT_SAMPLES[context.quick])
    return Measured(value=truth.relmse(found))
