"""The truth of a moved scene beside Mitsuba's own path integrator at the same points.

See `docs/decisions/0018-light-tracing-for-moved-rooms.md`: the reference's probes agree, but noise
in the change from frame to frame keeps them from being the truth of this study.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.studies.aliasing.light_tracing import traced_light
from experiments.studies.aliasing.moved_rooms import (
    BATCHES,
    FINEST_VOXEL,
    PATHS,
    PHASES,
    RECEIVERS,
    moved_scene,
    wall_points,
)
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from reference import probe_irradiance

LEVEL = 1
"""In whose voxels things move."""

PROBE_RAYS = 16384
"""Rays of a probe in a batch."""

FURTHEST = 0.03
"""Relative, between both means; three standard errors of the probes."""


@dataclass(frozen=True)
class TwoTruths:
    """Light of two neighbouring frames [batch, frame, point, rgb], each batch of one seed."""

    from_lamp: np.ndarray
    from_receivers: np.ndarray


def checks() -> list[Check]:
    """Return the checks of the truth."""
    found = []
    for mover in ("light", "object"):
        scene = (
            f"room two wide, {mover} moved by a 16th of a voxel of {FINEST_VOXEL * 2.0**LEVEL:g}"
        )
        paths = f"paths from the lamp; {PROBE_RAYS} rays from a point by Mitsuba's `path`"
        found.append(
            Check(
                name=f"truth, moved {mover}, Mitsuba's path integrator over light tracing",
                configuration=paths,
                scene=scene,
                measure=partial(_agreement, mover=mover),
                limit_low=1.0 - FURTHEST,
                limit_high=1.0 + FURTHEST,
                goal=1.0,
            )
        )
        found += [
            Check(
                name=f"truth, moved {mover}, noise of a change, {words}",
                configuration=f"standard deviation of a batch over the mean light; {paths}",
                scene=scene,
                measure=partial(_noise, mover=mover, which=which),
                goal=0.0,
            )
            for words, which in (
                ("light tracing", "from_lamp"),
                ("Mitsuba's path integrator", "from_receivers"),
            )
        ]
    return found


def two_truths(context: StudyContext, mover: str) -> TwoTruths:
    """Trace both ways, once."""

    def trace() -> TwoTruths:
        points, normals = wall_points(RECEIVERS[True])
        step = np.array([FINEST_VOXEL * 2.0**LEVEL / PHASES[False], 0.0, 0.0])
        still, batch_count = np.zeros(3), BATCHES[True]
        lamp, probes = [], []
        for frame in range(2):
            context.progress(f"truth, {mover}", frame / 2)
            moved = [frame * step if mover == name else still for name in ("light", "object")]
            scene = moved_scene(still, moved[0], None if mover == "light" else moved[1])
            lamp.append(
                np.stack(
                    [
                        traced_light(scene, points, normals, PATHS[False], k)
                        for k in range(batch_count)
                    ]
                )
            )
            found = probe_irradiance(
                scene, points, normals, samples=batch_count * PROBE_RAYS, batch_count=batch_count
            )
            probes.append(found.batches("indirect").astype(np.float64) / math.pi)
        return TwoTruths(np.stack(lamp, axis=1), np.stack(probes, axis=1))

    return context.once(f"two truths, {mover}", trace)


def _agreement(context: StudyContext, mover: str) -> Measured:
    found = two_truths(context, mover)
    lamp = float(found.from_lamp.mean())
    return mean_of([float(batch.mean()) / lamp for batch in found.from_receivers])


def _noise(context: StudyContext, mover: str, which: str) -> Measured:
    light: np.ndarray = getattr(two_truths(context, mover), which)
    variance = np.diff(light, axis=1).var(axis=0, ddof=1).mean()
    return Measured(value=math.sqrt(float(variance)) / float(light.mean()))
