"""What is made larger, and the work whose cost is measured for it.

Pixels, cones and traced pixels: a still frame of a lit room. Levels, voxels and lights: voxels
filled, lit and downsampled. Triangles: wavy sheets voxelized.
"""

from __future__ import annotations

import gc
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import drjit as dr
import mitsuba as mi

import vctgi
from experiments.bench.kernels import APPLICATION, KernelClock
from experiments.bench.reads import counting
from experiments.scenes import load_scene
from experiments.studies.check import StudyContext
from experiments.studies.growth.exponents import Cost
from experiments.studies.representation.speed_scenes import sheets
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig
from vctgi.pipeline import LitVolume, PreparedScene, voxelize_scene
from vctgi.prepared import StageClock, no_clock
from vctgi.stages.reconstruction.config import ReconstructionConfig
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid
from vctgi.stages.voxelization.opacity import voxelize_opacity

DEVICE, COUNT, MEMORY = "device time", "count", "memory"
"""Costs: s; texel reads of cones, or operations times lanes of kernels; bytes at the peak."""

COSTS = (DEVICE, COUNT, MEMORY)

REPETITIONS: Final = {True: 3, False: 7}
"""Timed runs in the quick study and in the whole one, after one that compiles."""

PLAIN: Final = RenderConfig(
    clipmap=ClipmapConfig(resolution=32, level_count=3),
    diffuse=replace(RenderConfig().diffuse, near_field_voxels=0.0),
    reconstruction=ReconstructionConfig(sparsity=1),
    samples_per_pixel=1,
)
"""Cones at every pixel, without real rays."""

SQUARE: Final = {True: 64, False: 256}
"""Pixels along an edge, where they are not what grows."""


@dataclass(frozen=True, kw_only=True)
class Axis:
    """Something that grows.

    Attributes
    ----------
    name, label
        For rows, and for the axis of a chart.
    sizes
        In the quick study and in the whole one, in any order.
    work
        Returns what is run for a size, under a clock and counted.
    counted
        What the count is.
    note
        Why nothing is asked of it; "": it must not grow faster than in proportion.
    """

    name: str
    label: str
    sizes: dict[bool, Sequence[float]]
    work: Callable[[StudyContext, float], Work]
    counted: str
    note: str = ""


@dataclass(frozen=True)
class Work:
    """What is run for a size.

    Attributes
    ----------
    run
        Does it, and has the device do all of it.
    reads
        Returns the texels that it reads; None: operations of its kernels are counted.
    size
        The place on the axis, where it is not the size itself.
    """

    run: Callable[[StageClock], None]
    reads: Callable[[], int] | None = None
    size: float | None = None


def costs_of(context: StudyContext, axis: Axis) -> dict[str, list[Cost]]:
    """Return the costs at each size, by kind of cost; measured once."""

    def measure() -> dict[str, list[Cost]]:
        sizes = axis.sizes[context.quick]
        found: dict[str, list[Cost]] = {each: [] for each in COSTS}
        for number, size in enumerate(sizes):
            context.progress(axis.name, number / len(sizes))
            work = axis.work(context, size)
            place = size if work.size is None else work.size
            for kind, values in _measured(work, REPETITIONS[context.quick]).items():
                cost = Cost(place, statistics.median(values), min(values), max(values))
                found[kind].append(cost)
        return {kind: sorted(each, key=lambda cost: cost.size) for kind, each in found.items()}

    return context.once(f"growth: {axis.name}", measure)


def _measured(work: Work, repetitions: int) -> dict[str, list[float]]:
    clock = KernelClock()
    times: list[float] = []
    operations = 0
    for number in range(1 + repetitions):
        with clock.watched() as found:
            work.run(clock)
        stages = [each for stage, each in found.items() if stage != APPLICATION]
        operations = sum(each.lane_operations for each in stages)
        if number:
            times.append(sum(each.device for each in stages))
    count = operations if work.reads is None else work.reads()
    return {DEVICE: times, COUNT: [float(count)], MEMORY: [_peak_bytes(work)]}


def _peak_bytes(work: Work) -> float:
    """Return what Dr.Jit's allocator holds at most during a run, beyond what it held before."""
    backend = dr.backend_v(mi.Float)
    gc.collect()
    dr.sync_thread()
    dr.flush_malloc_cache()
    dr.detail.malloc_clear_statistics()
    before = dr.detail.malloc_watermark(backend)
    work.run(no_clock)
    dr.sync_thread()
    return float(dr.detail.malloc_watermark(backend) - before)


def _frames(prepared: PreparedScene, lit: LitVolume, config: RenderConfig) -> Work:
    """Return the work of a still frame."""
    volume, take_count = counting(lit.volume)

    def reads() -> int:
        vctgi.render_frame(prepared, volume, config)
        return take_count()

    def run(clock: StageClock) -> None:
        vctgi.render_frame(prepared, lit.volume, config, clock)

    return Work(run, reads)


def _room(context: StudyContext, edge: tuple[int, int]) -> tuple[PreparedScene, LitVolume]:
    """Return the Cornell box at a size of the picture, lit once for all of them."""

    def light() -> LitVolume:
        return vctgi.light_volume(prepared, PLAIN)

    loaded = load_scene("cornell_box", resolution=edge)
    prepared = vctgi.prepare_scene(loaded.scene, loaded.scene.sensors()[0], PLAIN)
    return prepared, context.once("growth: room", light)


def _pixels(context: StudyContext, size: float) -> Work:
    edge = round(size**0.5)
    prepared, lit = _room(context, (edge, edge))
    return replace(_frames(prepared, lit, PLAIN), size=float(edge * edge))


def _cones(context: StudyContext, size: float) -> Work:
    edge = SQUARE[context.quick]
    prepared, lit = _room(context, (edge, edge))
    diffuse = replace(PLAIN.diffuse, cone_count=int(size))
    return _frames(prepared, lit, replace(PLAIN, diffuse=diffuse))


def _cones_of_one_width(context: StudyContext, size: float) -> Work:
    edge, count = SQUARE[context.quick], int(size)
    prepared, lit = _room(context, (edge, edge))
    aperture = max(PLAIN.diffuse.cones().apertures)
    diffuse = replace(PLAIN.diffuse, cone_count=count, cone_apertures=(aperture,) * count)
    return _frames(prepared, lit, replace(PLAIN, diffuse=diffuse))


def _traced(context: StudyContext, size: float) -> Work:
    edge = SQUARE[context.quick]
    prepared, lit = _room(context, (edge, edge))
    sparse = ReconstructionConfig(sparsity=int(size))
    traced = SparseGrid(width=edge, height=edge, edge=sparse.edge).block_count
    frames = _frames(prepared, lit, replace(PLAIN, reconstruction=sparse))
    return replace(frames, size=float(traced))


def _lit(prepared: PreparedScene, config: RenderConfig) -> Work:
    """Return the work of filling and lighting voxels."""

    def run(clock: StageClock) -> None:
        voxels = voxelize_scene(prepared, config, clock)
        vctgi.light_volume(prepared, config, clock, voxels)

    return Work(run)


def _levels(context: StudyContext, size: float) -> Work:
    clipmap = replace(PLAIN.clipmap, level_count=int(size), resolution=32 if context.quick else 64)
    return _lit_corridor(replace(PLAIN, clipmap=clipmap))


def _voxels(context: StudyContext, size: float) -> Work:
    clipmap = replace(PLAIN.clipmap, level_count=2, resolution=int(size))
    return replace(_lit_corridor(replace(PLAIN, clipmap=clipmap)), size=2.0 * size**3)


def _lit_corridor(config: RenderConfig) -> Work:
    loaded = load_scene("corridor", resolution=(16, 16))
    prepared = vctgi.prepare_scene(loaded.scene, loaded.scene.sensors()[0], config)
    return _lit(prepared, config)


def _lights(context: StudyContext, size: float) -> Work:
    scene = mi.load_dict(room_with_lamps(int(size)))
    prepared = vctgi.prepare_scene(scene, scene.sensors()[0], PLAIN)
    return _lit(prepared, PLAIN)


def room_with_lamps(count: int) -> dict[str, object]:
    """Return the Cornell box with so many point lights in a lattice under its ceiling."""
    scene: dict[str, object] = dict(mi.cornell_box())  # type: ignore[no-untyped-call]
    del scene["light"]
    edge = 1
    while edge**2 < count:
        edge += 1
    for number in range(count):
        x, z = (0.8 * (2.0 * ((each + 0.5) / edge) - 1.0) for each in divmod(number, edge))
        scene[f"lamp_{number}"] = {
            "type": "point",
            "position": [x, 0.8, z],
            "intensity": {"type": "rgb", "value": 1.0 / count},
        }
    return scene


def _triangles(context: StudyContext, size: float) -> Work:
    scene = sheets(int(size), 32 if context.quick else 64)

    def run(clock: StageClock) -> None:
        with clock("opacity voxelization"):
            dr.eval(voxelize_opacity(scene.surfaces, scene.layout).levels)

    return replace(Work(run), size=float(len(scene.surfaces.vertices)))


READS, OPERATIONS = "texel reads", "operations times lanes of the kernels"

AXES = (
    Axis(
        name="pixels",
        label="pixels, each with cones",
        sizes={True: (1 << 10, 1 << 12, 1 << 14), False: (1 << 12, 1 << 14, 1 << 16, 1 << 18)},
        work=_pixels,
        counted=READS,
    ),
    Axis(
        name="cones",
        label="diffuse cones a pixel",
        sizes={True: (6, 17, 48), False: (6, 9, 17, 32, 64)},
        work=_cones,
        counted=READS,
        note="cones that share a hemisphere are narrower the more they are, by the root of their "
        "number, and take as many more steps: 1.5 is what follows",
    ),
    Axis(
        name="cones of one width",
        label="diffuse cones a pixel, each as wide",
        sizes={True: (6, 17, 48), False: (6, 9, 17, 32, 64)},
        work=_cones_of_one_width,
        counted=READS,
    ),
    Axis(
        name="traced pixels",
        label="pixels that trace cones, one in N of all",
        sizes={True: (16, 9, 4, 1), False: (16, 9, 4, 1)},
        work=_traced,
        counted=READS,
    ),
    Axis(
        name="levels",
        label="levels of the clipmap",
        sizes={True: (1, 2, 4), False: (1, 2, 3, 4, 5)},
        work=_levels,
        counted=OPERATIONS,
    ),
    Axis(
        name="voxels",
        label="voxels of all levels",
        sizes={True: (16, 32, 64), False: (16, 32, 64, 128)},
        work=_voxels,
        counted=OPERATIONS,
    ),
    Axis(
        name="triangles",
        label="triangles",
        sizes={True: (10**3, 10**4, 10**5), False: (10**4, 10**5, 10**6, 10**7)},
        work=_triangles,
        counted=OPERATIONS,
    ),
    Axis(
        name="lights",
        label="point lights",
        sizes={True: (1, 10, 100), False: (1, 10, 100, 1000)},
        work=_lights,
        counted=OPERATIONS,
    ),
)
