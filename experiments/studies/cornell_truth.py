"""One diffuse bounce in the Cornell box: what tracers find against paths at the same points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.studies.check import StudyContext
from experiments.studies.cornell import (
    CornellBox,
    Receivers,
    cornell_box,
    path_traced,
    primary_hits,
)
from experiments.studies.tracers import Bench, ByTracer, by_tracer

SCENE = "mi.cornell_box(), E / pi of one bounce at primary hits"

PICTURE_EDGE = (64, 24)
"""Pixels along an edge, in a whole study and in a quick one."""

PATH_COUNT = (2048, 1024)
"""Paths a point of each half of the reference."""

RELATIVE_FLOOR = {"relMSE": 0.01, "mre": 0.1}
"""Share of the mean reference that keeps the dark finite: of its square, and of itself."""


@dataclass(frozen=True)
class CornellTruth:
    """The room at no offset, its receivers, and what paths bring them in two halves.

    What is compared with them is incident radiance [point, rgb].
    """

    room: CornellBox
    at: Receivers
    halves: tuple[np.ndarray, np.ndarray]

    @property
    def mean(self) -> np.ndarray:
        """Mean of the halves."""
        mean: np.ndarray = 0.5 * (self.halves[0] + self.halves[1])
        return mean

    def energy(self, found: np.ndarray) -> float:
        """Mean V / mean R."""
        return float(found.mean() / self.mean.mean())

    def relmse(self, found: np.ndarray) -> float:
        """Mean (V - R1)(V - R2) / (R^2 + floor): the noise of the halves has no bias in it."""
        first, second = self.halves
        scale = self.mean**2 + RELATIVE_FLOOR["relMSE"] * self.mean.mean() ** 2
        return float(np.mean((found - first) * (found - second) / scale))

    def mre(self, found: np.ndarray) -> float:
        """Mean |V - R| / (R + floor); it keeps what noise the reference has."""
        scale = self.mean + RELATIVE_FLOOR["mre"] * self.mean.mean()
        return float(np.mean(np.abs(found - self.mean) / scale))


def cornell_truth(context: StudyContext) -> CornellTruth:
    """Return receivers and paths, traced once in a study."""

    def make() -> CornellTruth:
        room = cornell_box(np.zeros(3))
        at = primary_hits(room, PICTURE_EDGE[context.quick])
        context.progress("paths", 0.0)
        paths = PATH_COUNT[context.quick]
        first, second = (path_traced(room, at, paths, seed) for seed in (1, 2))
        return CornellTruth(room, at, (first, second))

    return context.once("Cornell box, paths", make)


def cornell_by(context: StudyContext, bench: Bench) -> ByTracer:
    """Incident radiance [point, rgb] that the tracers of a bench find; found once."""
    truth = cornell_truth(context)
    layout = bench.layout(context, truth.room.triangles)

    def at_phase(phase: np.ndarray) -> dict[str, np.ndarray]:
        offset = phase * layout.coarsest.voxel_size
        room = cornell_box(offset)
        volume = bench.light(room.scene, layout, room.radiance)
        return bench.gather(volume, room.scene, truth.at.points + offset, truth.at.normals)

    return context.once(f"{bench.name}, Cornell box", partial(by_tracer, context, bench, at_phase))


def scores(
    context: StudyContext,
    bench: Bench,
    tracer: str,
    score: Callable[[CornellTruth, np.ndarray], float],
) -> list[float]:
    """Return `score`, one of `CornellTruth`'s, of what a tracer finds at each phase."""
    truth = cornell_truth(context)
    return [score(truth, found) for found in cornell_by(context, bench)[tracer]]
