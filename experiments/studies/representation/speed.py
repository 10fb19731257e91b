"""Speed and memory of voxelization: a rebuild, a camera step, a moved object, and how they grow.

Times are of the device: the run time of the kernels, without the tracing of Python code, which is
reported apart. They are medians over repetitions after a first one that compiles.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.representation.speed_scenes import CONFIGURATION, SpeedScene, speed_scene
from vctgi.clipmap.levels import ClipmapLayout, move_clipmap
from vctgi.clipmap.regions import Bounds, stale_regions, unmerged_regions
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.downsampling import downsample, downsample_regions
from vctgi.stages.voxelization.opacity import voxelize_triangles
from vctgi.stages.voxelization.triangles import DeviceTriangles, upload_triangles
from vctgi.stages.voxelization.update import changed_bounds, update_opacity

REPETITIONS = 5
CAMERA_STEPS = 32
"""One finest voxel each."""

LONGEST_REBUILD = {dr.JitBackend.LLVM: 8.0, dr.JitBackend.CUDA: 0.008}
"""Seconds on two CPU cores, and on an NVIDIA H200."""

UPDATE_SHARE = 0.1
"""Of the time of a rebuild, that an update may take."""

LARGEST_SHARE = {dr.JitBackend.LLVM: UPDATE_SHARE, dr.JitBackend.CUDA: None}
"""A GPU has a goal alone: there an update is a dozen launches of some microseconds each, whatever
they do, so its limit is a tenth of the longest time that a rebuild may take."""


@dataclass(frozen=True)
class Timing:
    """Seconds: of the kernels alone, and until the host went on."""

    device: float
    wall: float


def timed(work: Callable[[], object]) -> Timing:
    """Time what `work` launches."""
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        start = time.perf_counter()
        work()
        dr.sync_thread()
        wall = time.perf_counter() - start
        kernels = dr.kernel_history()
    return Timing(sum(kernel["execution_time"] for kernel in kernels) / 1e3, wall)


def checks() -> list[Check]:
    """Return the checks of speed."""
    backend = dr.backend_v(mi.Float)
    longest, share = LONGEST_REBUILD[backend], LARGEST_SHARE[backend]
    rows: list[tuple[str, Callable[[StudyContext], Measured], float | None, float | None]] = [
        ("rebuild, device time, s", _rebuild_device, longest, None),
        ("rebuild, wall time, s", _rebuild_wall, None, None),
        ("camera step, device time, s", _camera_device, UPDATE_SHARE * longest, None),
        ("camera step, wall time, s", _camera_wall, None, None),
        ("camera step over rebuild, mean", partial(_camera_step, worst=False), share, UPDATE_SHARE),
        ("camera step over rebuild, worst", partial(_camera_step, worst=True), None, UPDATE_SHARE),
        ("moved object, device time, s", _moved_device, UPDATE_SHARE * longest, None),
        ("moved object over rebuild", _moved_object, share, UPDATE_SHARE),
        ("downsampling, device time, s", _downsampling, None, None),
        ("camera step with downsampling over both", _camera_with_mips, share, UPDATE_SHARE),
    ]
    return [
        Check(
            name=f"speed: {name}",
            configuration=CONFIGURATION,
            scene="that of --scene, or wavy sheets of 262,144 triangles",
            measure=measure,
            limit_high=limit,
            goal=goal,
        )
        for name, measure, limit, goal in rows
    ]


@dataclass
class _Rebuilt:
    scene: SpeedScene
    opacity: OpacityClipmap
    voxelization: list[Timing]
    downsampling: list[Timing]


def _rebuilt(context: StudyContext) -> _Rebuilt:
    def measure() -> _Rebuilt:
        scene = speed_scene(context)
        triangles = upload_triangles(scene.surfaces)
        found: list[OpacityClipmap] = []

        def rebuild() -> None:
            found[:] = [voxelize_triangles(triangles, scene.layout)]
            dr.eval(found[0].levels)

        def merge() -> None:
            dr.eval(downsample(found[0], None)[0].levels)

        voxelization, downsampling = [], []
        for number in range(1 + REPETITIONS):
            context.progress("rebuilding", number / (1 + REPETITIONS))
            voxelization.append(timed(rebuild))
            downsampling.append(timed(merge))
        return _Rebuilt(scene, found[0], voxelization[1:], downsampling[1:])

    return context.once("speed: rebuild", measure)


def _rebuild_device(context: StudyContext) -> Measured:
    return _median([each.device for each in _rebuilt(context).voxelization])


def _rebuild_wall(context: StudyContext) -> Measured:
    return _median([each.wall for each in _rebuilt(context).voxelization])


def _downsampling(context: StudyContext) -> Measured:
    return _median([each.device for each in _rebuilt(context).downsampling])


@dataclass
class _Steps:
    voxelization: list[Timing]
    downsampling: list[Timing]


def _steps(context: StudyContext) -> _Steps:
    def measure() -> _Steps:
        built = _rebuilt(context)
        scene = built.scene
        triangles = upload_triangles(scene.surfaces)
        steps = _Steps([], [])
        # The first walk compiles.
        for is_timed in (False, True):
            opacity = voxelize_triangles(triangles, scene.layout)
            merged, _ = downsample(opacity, None)
            for number in range(CAMERA_STEPS):
                context.progress("moving the camera", number / CAMERA_STEPS)
                before = opacity.layout
                shift = scene.layout.finest_voxel_size * (number + 1) * scene.direction
                x, y, z = (np.array(scene.layout.centre) + shift).tolist()
                after = move_clipmap(scene.layout, (x, y, z))
                held = [opacity]
                first = timed(partial(_follow, held, triangles, after, []))
                opacity = held[0]
                merged = OpacityClipmap(after, merged.levels, merged.rule)
                unmerged = unmerged_regions(before, after, stale_regions(before, after, [], 0))
                second = timed(partial(downsample_regions, opacity, None, merged, None, unmerged))
                if is_timed:
                    steps.voxelization.append(first)
                    steps.downsampling.append(second)
        return steps

    return context.once("speed: steps", measure)


def _camera_step(context: StudyContext, *, worst: bool) -> Measured:
    whole = _rebuild_device(context).value
    shares = [each.device / whole for each in _steps(context).voxelization]
    return Measured(value=max(shares) if worst else statistics.fmean(shares))


def _camera_wall(context: StudyContext) -> Measured:
    return _median([each.wall for each in _steps(context).voxelization])


def _camera_with_mips(context: StudyContext) -> Measured:
    whole = _rebuild_device(context).value + _downsampling(context).value
    steps = _steps(context)
    pairs = zip(steps.voxelization, steps.downsampling, strict=True)
    return Measured(value=statistics.fmean((a.device + b.device) / whole for a, b in pairs))


def _camera_device(context: StudyContext) -> Measured:
    return _median([each.device for each in _steps(context).voxelization])


def _moved(context: StudyContext) -> list[Timing]:
    def measure() -> list[Timing]:
        scene = _rebuilt(context).scene
        moved = _move_some(scene)
        changed = changed_bounds(scene.surfaces, moved)
        states = [upload_triangles(scene.surfaces), upload_triangles(moved)]
        held = [voxelize_triangles(states[0], scene.layout)]
        timings = [
            timed(partial(_follow, held, states[(number + 1) % 2], scene.layout, changed))
            for number in range(2 + REPETITIONS)
        ]
        return timings[2:]

    return context.once("speed: moved", measure)


def _moved_device(context: StudyContext) -> Measured:
    return _median([each.device for each in _moved(context)])


def _moved_object(context: StudyContext) -> Measured:
    whole = _rebuild_device(context).value
    return _median([each.device / whole for each in _moved(context)])


def _follow(
    held: list[OpacityClipmap],
    triangles: DeviceTriangles,
    layout: ClipmapLayout,
    changed: list[Bounds],
) -> None:
    """Update the voxels in `held`."""
    held[0], _ = update_opacity(held[0], triangles, layout, changed)


def _move_some(scene: SpeedScene) -> VoxelSurfaces:
    """Move the object by three finest voxels."""
    vertices = scene.surfaces.vertices.copy()
    vertices[scene.moving] += 3.0 * scene.layout.finest_voxel_size * scene.direction
    return replace(scene.surfaces, vertices=vertices)


def _median(values: list[float]) -> Measured:
    return Measured(value=statistics.median(values), low=min(values), high=max(values))
