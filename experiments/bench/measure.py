"""A preset's benchmark: frames of each kind under the clocks, then the same frames counted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

import vctgi
from experiments.bench.floors import Sizes, floor_ms, least_bytes, own_voxels
from experiments.bench.kernels import APPLICATION, STAGES, KernelClock, Work
from experiments.bench.reads import counting, measure_rates
from experiments.bench.walks import KINDS, STILL, Walk, WalkedFrame
from experiments.bench.wall import WallTimes, wall_times
from experiments.clocks import MOST_FRAMES, WARM_FRAMES
from experiments.scenes import LoadedScene
from reports.bench_record import (
    ConeCounts,
    FrameResult,
    PresetResult,
    Rates,
    Spread,
    StageCounts,
    StageResult,
)
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.clipmap.storage import storage_in_use
from vctgi.clipmap.stored_directions import directions_of
from vctgi.config import RenderConfig
from vctgi.frame_pipeline import FrameTally
from vctgi.pipeline import PreparedScene
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid

TALK: Final = {
    "ambient": (3.1, 0.55, 0.35),
    "medium": (6.6, 1.18, 0.7),
    "high": (9.6, 1.72, 1.0),
    "ultra": (25.4, 4.5, 2.5),
}
"""Milliseconds at 1920x1080: on a GTX TITAN [Panteleev2014], scaled by texture rate (187 to 1045
GTexel/s) to an H200, and our goal there."""

COUNTED_FRAME: Final = 2
"""Of a walk, whose launches are counted: the first after which the finest window has moved."""

Progress = Callable[[str, float], None]
"""Told what is being done, and the share of it that is done."""

Watched = Callable[[int], tuple[dict[str, Work], WalkedFrame]]
"""Renders a frame by number, and returns what it launched."""


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """What is measured.

    Attributes
    ----------
    frames
        Of each walk, after those that warm up; 0: only counts matter, and one frame of each is
        rendered, which may have compiled.
    seconds
        After which a walk ends early, if it has a frame.
    resolution, level_count
        Of the clipmap; None: the preset's own.
    """

    frames: int
    seconds: float = 60.0
    resolution: int | None = None
    level_count: int | None = None


def bench_config(config: RenderConfig, options: BenchOptions) -> RenderConfig:
    """Return a preset as it is measured: at one camera ray a pixel, as the talk's."""
    clipmap: ClipmapConfig = config.clipmap
    if options.resolution is not None:
        clipmap = replace(clipmap, resolution=options.resolution)
    if options.level_count is not None:
        clipmap = replace(clipmap, level_count=options.level_count)
    return replace(config, clipmap=clipmap, samples_per_pixel=1)


def bench_preset(
    loaded: LoadedScene, name: str, options: BenchOptions, progress: Progress
) -> PresetResult:
    """Measure a preset on a scene."""
    config = bench_config(vctgi.preset(name), options)
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    progress(f"{name}: reading the scene", 0.0)
    prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
    cones, reads, rates = _count_cones(prepared, config)
    frames = []
    for place, kind in enumerate(KINDS):

        def tell(share: float, place: int = place, kind: str = kind) -> None:
            progress(f"{name}: {kind}", (place + share) / len(KINDS))

        frames.append(_bench_walk(Walk(prepared, config, kind), options, (reads, rates), tell))
    talk, scaled, goal = TALK.get(name, (None, None, None))
    return PresetResult(
        preset=name,
        configuration=_describe(prepared, config),
        cones=cones,
        rates=rates,
        frames=frames,
        talk_ms=talk,
        scaled_ms=scaled,
        goal_ms=goal,
    )


def _count_cones(
    prepared: PreparedScene, config: RenderConfig
) -> tuple[ConeCounts, dict[str, int], Rates]:
    """Count what a still frame reads, by stage, and measure how fast its volume is read alone."""
    walk = Walk(prepared, config, STILL)
    rates = measure_rates(walk.volume)
    volume, take_count = counting(walk.volume)
    clock = KernelClock(take_count)
    with clock.watched() as work:
        tally: FrameTally = walk.count(volume, clock)
    reads = {stage: each.reads for stage, each in work.items()}
    samples = tally.gathering.sample_count + tally.specular.sample_count
    if samples and not sum(reads.values()):
        raise RuntimeError(
            "the cones took samples of the voxels and none was counted: the march no longer reads "
            "by VoxelTexels.taps, so experiments/bench/reads.py has to count elsewhere."
        )
    return (
        ConeCounts(
            gathering_cones=tally.gathering.cone_count,
            gathering_samples=tally.gathering.sample_count,
            specular_cones=tally.specular.cone_count,
            specular_samples=tally.specular.sample_count,
            rays=tally.gathering.ray_count + tally.specular.ray_count,
            volume_bytes=walk.volume.byte_count,
        ),
        reads,
        rates,
    )


def _bench_walk(
    walk: Walk,
    options: BenchOptions,
    known: tuple[dict[str, int], Rates],
    progress: Callable[[float], None],
) -> FrameResult:
    reads, rates = known
    clock = KernelClock()

    def watched(number: int) -> tuple[dict[str, Work], WalkedFrame]:
        with clock.watched() as work:
            found = walk.frame(number, clock)
        return work, found

    if options.frames > 0:
        _warm_up(watched)
    counted, made = _counted(walk, watched)
    wall, works = WallTimes(0.0, 0.0, 0.0), [counted]
    if options.frames > 0:
        works = _timed(watched, options, progress)
        wall = wall_times(walk, options.seconds)
    walk.put_back()
    sizes = _sizes(walk, made)
    least = least_bytes(walk.kind, sizes, walk.config)
    stages = []
    for stage in STAGES:
        if not any(stage in work for work in works):
            continue
        own = counted.get(stage, Work())
        byte_count, read_count = least.get(stage, 0), reads.get(stage, 0)
        stages.append(
            StageResult(
                stage=stage,
                device_ms=_spread([work.get(stage, Work()).device for work in works]),
                counts=StageCounts(
                    launches=own.launches,
                    operations=own.operations,
                    lane_operations=own.lane_operations,
                    texel_reads=read_count,
                    bytes=byte_count,
                ),
                floor_ms=floor_ms(read_count, byte_count, rates),
            )
        )
    times = [
        sum(each.device for stage, each in work.items() if stage != APPLICATION) for work in works
    ]
    application = [work.get(APPLICATION, Work()).device for work in works]
    return FrameResult(
        kind=walk.kind,
        frame_count=len(works),
        device_ms=_spread(times),
        worst_frame=int(np.argmax(times)),
        application_ms=1e3 * float(np.median(application)),
        wall_ms=1e3 * wall.frame,
        host_ms=1e3 * max(wall.frame - wall.device, 0.0),
        loop_ms=1e3 * wall.loop,
        compiled=sum(each.compiled for work in works for each in work.values()),
        stages=stages,
    )


def _warm_up(watched: Watched) -> None:
    """Render until some frames in a row compile nothing, or so many that it is given up."""
    warm = 0
    for number in range(MOST_FRAMES):
        work, _ = watched(number)
        warm = 0 if any(each.compiled for each in work.values()) else warm + 1
        if warm == WARM_FRAMES:
            return


def _timed(
    watched: Watched,
    options: BenchOptions,
    progress: Callable[[float], None],
) -> list[dict[str, Work]]:
    """Return the work of a walk's frames, of fewer where time runs out."""
    works: list[dict[str, Work]] = []
    start = time.perf_counter()
    for number in range(options.frames):
        works.append(watched(number)[0])
        progress((number + 1) / options.frames)
        if time.perf_counter() - start > options.seconds:
            break
    return works


def _counted(walk: Walk, watched: Watched) -> tuple[dict[str, Work], WalkedFrame]:
    """Return work and frame of `COUNTED_FRAME`, reached from the first one in one step."""
    walk.frame(0)
    return watched(COUNTED_FRAME)


def _sizes(walk: Walk, made: WalkedFrame) -> Sizes:
    width, height = (int(n) for n in walk.prepared.sensor.film().crop_size())
    traced = width * height
    edge = walk.config.reconstruction.edge
    if edge > 1:
        grid = SparseGrid(width=width, height=height, edge=edge)
        traced = grid.column_count * grid.row_count
    alone = round(made.frame.refined_share * width * height)
    return Sizes(
        pixels=width * height,
        traced=traced + alone,
        triangles=len(walk.prepared.surfaces.vertices),
        own_voxels=own_voxels(walk.prepared),
        filled=made.filled_count,
        texels=made.texel_count,
        volume_bytes=made.volume.byte_count,
    )


def _spread(seconds: list[float]) -> Spread:
    low, middle, high = (1e3 * float(each) for each in np.quantile(seconds, [0.25, 0.5, 0.75]))
    return Spread(median=middle, low=low, high=high, worst=1e3 * max(seconds))


def _describe(prepared: PreparedScene, config: RenderConfig) -> str:
    layout = prepared.plan.layout
    cones = (
        f"{config.ambient.cone_count} ambient cones"
        if config.mode == "ambient"
        else f"{config.diffuse.cones().cone_count} diffuse cones"
    )
    specular = ", specular cones" if prepared.plan.has_specular else ""
    every = config.reconstruction.sparsity
    directions = prepared.plan.directions or directions_of(config.storage.direction_count)
    storage = storage_in_use(config.storage, layout, directions, has_derivatives=False)
    return (
        f"{layout.clip_level_count} levels of {layout.resolution}^3, {storage.format}; "
        f"{cones} at every {'' if every == 1 else f'{every}th '}pixel{specular}"
    )
