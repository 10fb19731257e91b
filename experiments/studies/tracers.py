"""What reads voxels in a study, and what it sees of a scene at several phases of the grid.

Filling voxels costs more than reading them with a few thousand cones, so everything that reads the
same voxels is measured together: a bench is one way to lay voxels out and light them, and its
tracers are the cones or rays that read them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

import mitsuba as mi
import numpy as np

from experiments.studies.check import StudyContext
from experiments.studies.exact_voxels import (
    Radiance,
    lay_out_window,
    light_exactly,
    scene_of,
)
from experiments.studies.phases import phase_offsets
from experiments.studies.scenes import ShiningScene
from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.storage import VoxelVolume
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, trace_diffuse

Found = TypeVar("Found")

PHASE_COUNTS: PhaseCounts = (8, 2)

LayOut = Callable[[np.ndarray], ClipmapLayout]
"""Places voxels around triangles [triangle, corner, 3]."""

PhaseCounts = tuple[int, int]
"""Phases of the grid in a whole study, and in a quick one."""

ByTracer = dict[str, list[np.ndarray]]
"""What each tracer found, by its name, at each phase."""


class Light(Protocol):
    """How light gets into voxels."""

    def __call__(self, scene: mi.Scene, layout: ClipmapLayout, radiance: Radiance) -> VoxelVolume:
        """Return lit voxels of a scene whose outgoing radiance is known."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Voxels of one kind, and all that reads them.

    Attributes
    ----------
    name
        Unique within a study.
    tracers
        Cones or rays, by name.
    lay_out, quick_lay_out
        Where the voxels lie, and where in a quick study if that has other ones.
    light
        How light gets into them.
    phases
        At how many places of the grid they are read.
    """

    name: str
    tracers: Mapping[str, DiffuseConesConfig]
    lay_out: LayOut = lay_out_window
    quick_lay_out: LayOut | None = None
    light: Light = light_exactly
    phases: PhaseCounts = PHASE_COUNTS

    def layout(self, context: StudyContext, triangles: np.ndarray) -> ClipmapLayout:
        """Return where the voxels lie around triangles [triangle, corner, 3]."""
        lay_out = self.quick_lay_out if context.quick and self.quick_lay_out else self.lay_out
        return lay_out(triangles)

    def gather(
        self, volume: VoxelVolume, scene: mi.Scene, points: np.ndarray, normals: np.ndarray
    ) -> dict[str, np.ndarray]:
        """E / pi [point, rgb] that each tracer brings to points [point, 3]."""
        return {
            name: gather(volume, scene, points, normals, cones)
            for name, cones in self.tracers.items()
        }


def gather(
    volume: VoxelVolume,
    scene: mi.Scene,
    points: np.ndarray,
    normals: np.ndarray,
    cones: DiffuseConesConfig,
) -> np.ndarray:
    """E / pi [point, rgb] that cones bring to points [point, 3]."""
    found = trace_diffuse(white_receivers(points, normals), volume, cones, scene)
    return np.array(found, dtype=np.float64).T


def over_phases(
    context: StudyContext,
    measure: Callable[[np.ndarray], Found],
    counts: PhaseCounts = PHASE_COUNTS,
) -> list[Found]:
    """Return what `measure` gives for each phase, an offset [3] in voxels of the coarsest level."""
    offsets = phase_offsets(counts[context.quick])
    found = []
    for number, offset in enumerate(offsets):
        context.progress("phases of the grid", number / len(offsets))
        found.append(measure(offset))
    return found


def by_tracer(
    context: StudyContext, bench: Bench, at_phase: Callable[[np.ndarray], dict[str, np.ndarray]]
) -> ByTracer:
    """Return what each tracer found at each phase, where `at_phase` gives it for all of them."""
    phases = over_phases(context, at_phase, bench.phases)
    return {name: [each[name] for each in phases] for name in bench.tracers}


def incident_in(context: StudyContext, bench: Bench, key: str, scene: ShiningScene) -> ByTracer:
    """E / pi [point] at the receivers of a scene; found once for a bench and a key."""
    layout = bench.layout(context, scene.triangles)

    def at_phase(offset: np.ndarray) -> dict[str, np.ndarray]:
        moved = scene.moved(offset * layout.coarsest.voxel_size)
        world = scene_of(moved.triangles)
        volume = bench.light(world, layout, constant_radiance(moved.radiance))
        found = bench.gather(volume, world, moved.points, moved.normals)
        return {name: each[:, 0] for name, each in found.items()}

    return context.once(f"{bench.name}, {key}", partial(by_tracer, context, bench, at_phase))


def constant_radiance(radiance: np.ndarray) -> Radiance:
    """Return grey light that leaves each triangle alike, from radiance [triangle]."""

    def leaving(_points: np.ndarray, _normals: np.ndarray, owner: np.ndarray) -> np.ndarray:
        return np.repeat(radiance[owner][:, None], 3, axis=1)

    return leaving
