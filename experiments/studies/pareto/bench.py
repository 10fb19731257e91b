"""All methods of one scene: rendered, timed in random order, compared with one reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from typing import Final, cast

import mitsuba as mi
import numpy as np

import reference
from experiments.clocks import Clocks, Job, NeverWarmError, Render, time_jobs
from experiments.scenes import LoadedScene, load_scene
from experiments.studies.check import RefusedError, StudyContext
from experiments.studies.pareto.cone_frames import (
    CAMERA,
    FRAMES,
    LIGHTS,
    STILL,
    LitScene,
    Update,
    indirect_image,
    light_key,
)
from experiments.studies.pareto.methods import (
    DENOISED,
    HIGH,
    OURS,
    Method,
    cone_methods,
    path_methods,
)
from experiments.studies.pareto.path_tracing import PathFrame, PathTracer
from experiments.studies.pareto.scores import Score, Truth, score, score_all
from vctgi.config import LEAST_SCATTERING_COUNT, RenderConfig
from vctgi.pipeline import Frame

QUICK_EDGE: Final = 32
EDGES: Final = {"llvm_ad_rgb": 48, "cuda_ad_rgb": 256}
"""Longer edge of the pictures, pixels, in the quick study and in the whole one."""

FIRST_NOISE: Final = 1e-2
"""Noise relMSE of the reference to begin with: what any scene can be brought to. In Sponza, whose
presets err by much more, 1e-3 takes most of the paths that are allowed."""

NOISE_SHARE: Final = 1.0 / 12.0
"""Of the smallest error of a preset, that the reference's noise is then brought to, if it must."""

HIDDEN_SHARE: Final = 0.1
"""Of the noise that hides an error, to which the next reference's is brought."""

MOST_REFERENCE_PATHS: Final = 1 << 16
MOST_REFERENCES: Final = 4
"""Each aims at the noise that the one before it asks for."""

COUNT: Final = LEAST_SCATTERING_COUNT
"""Scatterings of the light that is compared."""

SEED: Final = 8
"""Of the order of the methods."""

MOVING: Final = (CAMERA, LIGHTS)
"""Kinds of frames that bring the voxels up to date first."""

WARM_PATHS: Final = 64
"""Samples a pixel, at most, of the frames that warm paths up: kernels do not know their number."""

IMPORT_NAME: Final = "pyoidn"
"""Of the extra `[denoise]`."""


@dataclass(frozen=True)
class Result:
    """One method's times by kind of frame, and its errors.

    Attributes
    ----------
    method
        Which.
    clocks
        By kind of frame.
    score
        Errors of still frames.
    parts
        Of "high", whose moving frames are timed as a whole: the sum of their parts.
    """

    method: Method
    clocks: dict[str, Clocks]
    score: Score
    parts: dict[str, Clocks] = field(default_factory=dict)


@dataclass(frozen=True)
class Bench:
    """What was found of a scene.

    Attributes
    ----------
    loaded
        The scene.
    results
        By name of method.
    noise
        Of the reference, relMSE of its indirect light.
    """

    loaded: LoadedScene
    results: dict[str, Result]
    noise: reference.NoiseFloor


def has_denoiser() -> bool:
    """Whether the extra that denoises is installed."""
    return find_spec(IMPORT_NAME) is not None


def bench_of(context: StudyContext, source: str) -> Bench:
    """Return what was found of a scene, measured once.

    Raises
    ------
    RefusedError
        No reference is good enough, or a method compiles in every frame.
    """
    return bench_once(context, f"pareto of {source}", lambda: _measure(context, source))


def bench_once(context: StudyContext, key: str, find: Callable[[], Bench]) -> Bench:
    """Return what `find` finds, once for all checks that ask by the same key.

    Raises
    ------
    RefusedError
        No reference is good enough, or a method compiles in every frame.
    """

    def measure() -> Bench:
        try:
            return find()
        except (reference.NoisyReferenceError, NeverWarmError) as error:
            raise RefusedError(str(error)) from error

    return context.once(key, measure)


@dataclass
class _Kept:
    """Times and pictures as they come, of moving frames, too, or of still ones alone."""

    clocks: dict[tuple[str, str], Clocks]
    pictures: dict[str, list[np.ndarray]]
    has_moving: bool
    parts: dict[str, Clocks] = field(default_factory=dict)

    def take(self, jobs: dict[tuple[str, str], Job]) -> None:
        self.clocks |= {key: job.clocks for key, job in jobs.items()}

    def of(self, name: str) -> dict[str, Clocks]:
        """Return the times of a method by kind of frame."""
        return {kind: clocks for (each, kind), clocks in self.clocks.items() if each == name}


def _measure(context: StudyContext, source: str) -> Bench:
    edge = QUICK_EDGE if context.quick else EDGES[str(mi.variant())]
    loaded = load_scene(source, resolution=edge)
    return run_methods(
        context, loaded, cone_methods(quick=context.quick), path_methods(quick=context.quick)
    )


def run_methods(
    context: StudyContext,
    loaded: LoadedScene,
    cones: list[Method],
    paths: list[Method],
    *,
    has_moving: bool = True,
) -> Bench:
    """Render by all methods, time them in turns, and compare their pictures with a reference.

    Parameters
    ----------
    context
        The study.
    loaded
        The scene, at the size of the pictures.
    cones
        Methods by cones; the reference's noise must be below the errors of those of the family of
        presets.
    paths
        Methods by paths; the denoised ones are left out where nothing denoises.
    has_moving
        Whether moving frames are timed, too.

    Raises
    ------
    NoisyReferenceError
        No reference is good enough.
    NeverWarmError
        A method compiles in every frame.
    """
    random = np.random.default_rng(SEED)
    kept = _Kept({}, {}, has_moving)
    paths = [each for each in paths if each.family != DENOISED or has_denoiser()]
    blocks: dict[RenderConfig, list[Method]] = {}
    for method in cones:
        if not method.renders_like:
            assert method.config is not None, "cones have a configuration"
            blocks.setdefault(light_key(method.config), []).append(method)
    work: list[Callable[[Callable[[float], None]], None]] = [
        partial(_time_cones, loaded, key, (block, cones), kept, random)
        for key, block in blocks.items()
    ]
    work.append(partial(_time_paths, loaded, paths, kept, random))
    for done, index in enumerate(random.permutation(len(work))):
        work[index](lambda share, done=done: context.progress("timing", (done + share) / len(work)))
    for method in cones:
        if method.renders_like:
            own = kept.of(method.renders_like)
            kept.clocks |= {(method.name, kind): clocks for kind, clocks in own.items()}
    found = {each.name: each for each in (*cones, *paths)}
    truth, noise = _find_truth(context, loaded, kept.pictures, found)
    scores = score_all(kept.pictures, truth)
    results = {
        name: Result(method, kept.of(name), scores[name], kept.parts if name == HIGH else {})
        for name, method in found.items()
    }
    return Bench(loaded, results, noise)


def _time_cones(
    loaded: LoadedScene,
    key: RenderConfig,
    methods: tuple[list[Method], list[Method]],
    kept: _Kept,
    random: np.random.Generator,
    progress: Callable[[float], None],
) -> None:
    """Time the methods that gather from the same voxels, and what moving frames do before that.

    A moving frame is the sum of two parts, which run one after the other: voxels brought up to
    date, and cones gathering. Frames of "high" are timed as a whole, too.

    Parameters
    ----------
    loaded, key
        The scene, and how its voxels are lit.
    methods
        Those that are rendered, and all, some of which have their pictures from them.
    kept
        Takes times and pictures.
    random, progress
        As `time_jobs` takes them.
    """
    lit = LitScene.of(loaded, key)
    block, all_methods = methods
    jobs = {}
    for method in block:
        config = method.config
        assert config is not None, "cones have a configuration"
        alike = [method, *(each for each in all_methods if each.renders_like == method.name)]

        def keep(frame: object, alike: list[Method] = alike) -> None:
            for each in alike:
                image = indirect_image(cast(Frame, frame), each)
                kept.pictures.setdefault(each.name, []).append(image)

        jobs[method.name, STILL] = Job(method.name, lit.still(config), keep)
        if method.name == HIGH and kept.has_moving:
            jobs[method.name, LIGHTS] = Job(method.name, lit.moving_lights(config))
            jobs[method.name, CAMERA] = Job(method.name, lit.moving_camera(config))
    updates = {}
    if kept.has_moving:
        for kind in MOVING:
            updates[kind] = Job(f"voxels, {kind}", _seedless(lit.update(kind, key)))
    time_jobs([*jobs.values(), *updates.values()], random, progress=progress)
    kept.take(jobs)
    for method in block:
        gathering = jobs[method.name, STILL].clocks
        summed = {kind: job.clocks + gathering for kind, job in updates.items()}
        if method.name == HIGH:
            kept.parts = summed
        for kind, clocks in summed.items():
            kept.clocks.setdefault((method.name, kind), clocks)


def _seedless(update: Update) -> Render:
    return lambda _seed: update()


def _time_paths(
    loaded: LoadedScene,
    methods: list[Method],
    kept: _Kept,
    random: np.random.Generator,
    progress: Callable[[float], None],
) -> None:
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    tracer = PathTracer(scene=loaded.scene, sensor=sensor, scattering_count=COUNT)
    height, width = tracer.size
    jobs = {}
    for method in methods:
        trace = tracer.denoised if method.family == DENOISED else tracer.frame

        def keep(frame: object, name: str = method.name) -> None:
            image = cast(PathFrame, frame).image(height, width)
            kept.pictures.setdefault(name, []).append(image)

        count = method.samples_per_pixel
        short = partial(trace, min(count, WARM_PATHS))
        jobs[method.name] = Job(method.name, partial(trace, count), keep, warm_up=short)
    time_jobs(list(jobs.values()), random, progress=progress)
    # Paths start anew whatever moved.
    kinds = FRAMES if kept.has_moving else (STILL,)
    kept.take({(name, kind): job for name, job in jobs.items() for kind in kinds})


def _find_truth(
    context: StudyContext,
    loaded: LoadedScene,
    pictures: dict[str, list[np.ndarray]],
    methods: dict[str, Method],
) -> tuple[Truth, reference.NoiseFloor]:
    """Return a reference whose noise is ten times below the smallest error of a preset.

    Raises
    ------
    NoisyReferenceError
        There is none with as many paths as are allowed.
    """
    presets = [name for name, method in methods.items() if method.family == OURS]
    target = reference.ReferenceTarget(
        relmse=FIRST_NOISE,
        component="indirect",
        most_samples_per_pixel=MOST_REFERENCE_PATHS,
        scattering_count=COUNT,
    )
    for _ in range(MOST_REFERENCES):
        found = reference.render_to_target(
            loaded.scene,
            sensor=loaded.sensor_index,
            target=target,
            cache_directory=None,
            progress=lambda share: context.progress("path tracing", share),
        )
        shared = found.mean("direct") + found.mean("emission")
        truth = Truth.of(found.batches("indirect"), shared)
        smallest = min(score(pictures[name][:1], truth).relmse.value for name in presets)
        noise = reference.noise_floor(found, "indirect")
        is_hidden = not smallest > 0.0
        if not is_hidden and noise.upper <= reference.target_from_difference(smallest):
            break
        wanted = HIDDEN_SHARE * target.relmse if is_hidden else NOISE_SHARE * smallest
        target = replace(target, relmse=wanted)
    if is_hidden:
        raise reference.NoisyReferenceError(
            f"the error of a preset is hidden by the noise of the reference ({noise.value:.2g})."
        )
    reference.require_low_noise(found, smallest, ("indirect",))
    return truth, noise
