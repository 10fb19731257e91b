"""The same rows in a camera-centred clipmap, and what it costs against a single pyramid.

The viewer stands in the room, off its middle, so that the finest window holds a part of every scene
and coarser ones the rest. A pyramid over the whole scene with voxels as fine as the clipmap's
finest is what the clipmap saves; what it loses for that is the cost. The clipmap's coarsest window
reaches four times as far as the pyramid.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import drjit as dr
import numpy as np

from experiments.studies.accuracy.columns import COLUMNS, Column, Limits
from experiments.studies.accuracy.table import rows
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.cornell_truth import SCENE, CornellTruth, cornell_truth, scores
from experiments.studies.exact_voxels import (
    RESOLUTION,
    lay_out_window,
    light_exactly,
    surfaces_in,
)
from experiments.studies.representation.speed import Timing, timed
from experiments.studies.tracers import Bench
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import OpacityClipmap, VoxelVolume
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.downsampling import downsample
from vctgi.stages.voxelization.opacity import voxelize_triangles
from vctgi.stages.voxelization.triangles import upload_triangles

LEVEL_COUNT = 4

FINER = 2
"""Voxels of the clipmap's finest level to one of the table's pyramid."""

VIEWER = (0.3, -0.2, 0.6)
"""What the windows surround, world units; rooms are two wide around the origin."""

REPETITIONS = (5, 3)
"""Timings of which the median is taken, in the whole study and in the quick one."""


def lay_out_windows(triangles: np.ndarray, resolution: int = RESOLUTION) -> ClipmapLayout:
    """Return the clipmap around the viewer, whose finest window is half a pyramid wide."""
    voxel_size = _finest_voxel_size(triangles, resolution)
    return lay_out_clipmap(
        VIEWER, finest_voxel_size=voxel_size, level_count=LEVEL_COUNT, resolution=resolution
    )


def lay_out_fine_window(triangles: np.ndarray, resolution: int = RESOLUTION) -> ClipmapLayout:
    """Return a pyramid over the whole scene with voxels as fine as the clipmap's finest."""
    voxel_size = _finest_voxel_size(triangles, resolution)
    return lay_out_clipmap(
        (0.0, 0.0, 0.0),
        finest_voxel_size=voxel_size,
        level_count=1,
        resolution=FINER * resolution,
    )


def _finest_voxel_size(triangles: np.ndarray, resolution: int) -> float:
    return lay_out_window(triangles).finest_voxel_size * RESOLUTION / (FINER * resolution)


_QUICK_RESOLUTION = RESOLUTION // 2
_TRACERS = {column.name: column.cones for column in COLUMNS}

CLIPMAP = Bench(
    name="clipmap",
    tracers=_TRACERS,
    lay_out=lay_out_windows,
    quick_lay_out=partial(lay_out_windows, resolution=_QUICK_RESOLUTION),
)
FINE = Bench(
    name="fine pyramid",
    tracers=_TRACERS,
    lay_out=lay_out_fine_window,
    quick_lay_out=partial(lay_out_fine_window, resolution=_QUICK_RESOLUTION),
)

WORDS = {
    CLIPMAP.name: f"{LEVEL_COUNT} levels of {RESOLUTION}^3 around the viewer, exact light",
    FINE.name: f"pyramid of {FINER * RESOLUTION}^3 with voxels of the same size, exact light",
}


def checks() -> list[Check]:
    """Return the rows of all columns in a clipmap, and its costs."""
    found = []
    for column in COLUMNS:
        words = f"{column.words}; {WORDS[CLIPMAP.name]}"
        reported = replace(column, limits=Limits())
        found += rows(reported, CLIPMAP, f"{column.name}, clipmap", words)
    return [*found, *_costs()]


def _costs() -> list[Check]:
    found: list[tuple[str, Callable[[StudyContext], Measured], float | None]] = []
    for column in COLUMNS:
        for name, score in (("energy", CornellTruth.energy), ("relMSE", CornellTruth.relmse)):
            measure = partial(_difference, column=column, score=score)
            found.append((f"{name} difference, {column.name}", measure, 0.0))
    found.append(("memory of the voxels, ratio", _memory, None))
    found.append(("time to voxelize and downsample, ratio", _build_time, None))
    for column in COLUMNS:
        measure = partial(_trace_time, column=column)
        found.append((f"time to trace, ratio, {column.name}", measure, None))
    return [
        Check(
            name=f"clipmap against fine pyramid, {name}",
            configuration=f"{WORDS[CLIPMAP.name]}; {WORDS[FINE.name]}",
            scene=SCENE,
            measure=measure,
            goal=goal,
        )
        for name, measure, goal in found
    ]


def _difference(
    context: StudyContext, column: Column, score: Callable[[CornellTruth, np.ndarray], float]
) -> Measured:
    """Score in the clipmap less its mean in the pyramid, with the interval of the former."""
    fine = statistics.fmean(scores(context, FINE, column.name, score))
    return mean_of([each - fine for each in scores(context, CLIPMAP, column.name, score)])


def _volume(context: StudyContext, bench: Bench) -> VoxelVolume:
    room = cornell_truth(context).room

    def make() -> VoxelVolume:
        return light_exactly(room.scene, bench.layout(context, room.triangles), room.radiance)

    return context.once(f"{bench.name}, Cornell box at rest", make)


def _memory(context: StudyContext) -> Measured:
    sizes = [_volume(context, bench).byte_count for bench in (CLIPMAP, FINE)]
    return Measured(value=sizes[0] / sizes[1])


def _build_time(context: StudyContext) -> Measured:
    room = cornell_truth(context).room
    triangles = upload_triangles(surfaces_in(room.scene))

    def build(layout: ClipmapLayout) -> OpacityClipmap:
        merged, _ = downsample(voxelize_triangles(triangles, layout), None)
        dr.eval(merged.levels)
        return merged

    layouts = [bench.layout(context, room.triangles) for bench in (CLIPMAP, FINE)]
    return _ratio(context, [partial(build, layout) for layout in layouts])


def _trace_time(context: StudyContext, column: Column) -> Measured:
    truth = cornell_truth(context)
    at = white_receivers(truth.at.points, truth.at.normals)

    def trace(volume: VoxelVolume) -> object:
        found = trace_diffuse(at, volume, column.cones, truth.room.scene)
        dr.eval(found)
        return found

    volumes = [_volume(context, bench) for bench in (CLIPMAP, FINE)]
    return _ratio(context, [partial(trace, volume) for volume in volumes])


def _ratio(context: StudyContext, both: list[Callable[[], object]]) -> Measured:
    """Device time of the first over that of the second, medians, with the range of its pairs."""
    context.progress("timing", 0.0)
    for each in both:
        each()  # compiles
    pairs: list[tuple[Timing, Timing]] = [
        (timed(both[0]), timed(both[1])) for _ in range(REPETITIONS[context.quick])
    ]
    ratios = [first.device / second.device for first, second in pairs]
    return Measured(value=statistics.median(ratios), low=min(ratios), high=max(ratios))
