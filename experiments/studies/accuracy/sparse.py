"""What tracing fewer pixels changes: sparse diffuse light against dense.

A frame of few cones is noisy, dense or sparse, so the truth is the mean of many dense frames. One
frame differs from it by noise and by interpolation; the dense frame of as many rays, which stands
beside it, by noise alone. What interpolation itself does is what is left when the mean of many
sparse frames is compared: that is held to limits. All look through the same places of each pixel,
so that edges and textures are the same. The noise of both means is known from their two halves, and
taken out in quadrature, which is right for normal errors.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

import vctgi
from experiments.scenes import load_scene
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from vctgi.pipeline import Frame, LitVolume, PreparedScene

Measure = Callable[..., Measured]

LIMITS = {1: None, 4: 0.02, 9: 0.03, 16: 0.05}
"""Mean relative difference from dense light that is allowed, by the sparsity."""

LARGEST_REFINED = 0.06
"""Share of the camera rays that may have to trace for themselves. Sponza at 1024 pixels needs
0.027, 0.044 and 0.059, 0.01 of it because its light changes (docs/decisions/0016); at fewer
pixels it needs more, and says so."""

EDGE = (256, 128)
SCENE_EDGE = (1024, 256)
HALF_COUNT = (8, 3)
"""Picture in pixels, of the Cornell box and of a scene that was asked for, which has finer things
to lose; and frames in each half of a mean. All in the whole study and in the quick one."""


@dataclass(frozen=True)
class _Truth:
    """The scene, and the mean of many dense frames with the mean relative error that it has."""

    prepared: PreparedScene
    lit: LitVolume
    mean: np.ndarray
    noise: float


@dataclass(frozen=True)
class _Found:
    """Frames of one sparsity against the truth: each of them, and their mean."""

    single: list[float]
    systematic: float
    refined: list[float]
    seconds: list[float]


def checks() -> list[Check]:
    """Return the checks of sparse pixels."""
    found = []
    for sparsity, limit in LIMITS.items():
        frame = "dense frame" if sparsity == 1 else f"every {sparsity}th pixel"
        parts: dict[str, tuple[Measure, float | None]] = {
            "one frame, mean relative difference from many dense frames": (_single, None)
        }
        if sparsity > 1:
            parts["mean relative difference from dense light"] = (_systematic, limit)
            parts["share of the rays refined"] = (_refined, LARGEST_REFINED)
        parts["seconds of a frame"] = (_seconds, None)
        for name, (measure, high) in parts.items():
            found.append(
                Check(
                    name=f"sparse, {frame}, {name}",
                    configuration='preset "high" with N = 64, '
                    + ("cones of every ray" if sparsity == 1 else f"sparsity {sparsity}"),
                    scene="built-in cornell_box, or --scene; diffuse light, 4 rays a pixel",
                    measure=partial(measure, sparsity=sparsity),
                    limit_high=high,
                    goal=0.0,
                )
            )
    return found


def sparse_config(sparsity: int) -> vctgi.RenderConfig:
    """Return the preset "high" at 64^3 voxels with a sparsity."""
    config = vctgi.preset("high")
    return replace(
        config,
        clipmap=replace(config.clipmap, resolution=64),
        reconstruction=replace(config.reconstruction, sparsity=sparsity),
    )


def _share(difference: np.ndarray, picture: np.ndarray) -> float:
    """Mean absolute difference over the mean."""
    return math.fsum(np.abs(difference).ravel()) / math.fsum(picture.ravel())


def _frames(context: StudyContext, sparsity: int) -> _Found:
    """Render and compare, once for all checks of a sparsity."""

    def prepare() -> _Truth:
        name = context.scene or "cornell_box"
        edges = EDGE if context.scene is None else SCENE_EDGE
        loaded = load_scene(name, resolution=edges[context.quick])
        config = sparse_config(1)
        prepared = vctgi.prepare_scene(
            loaded.scene, loaded.scene.sensors()[loaded.sensor_index], config
        )
        lit = vctgi.light_volume(prepared, config)
        halves = [np.zeros(()), np.zeros(())]
        count = HALF_COUNT[context.quick]
        for number in range(2 * count):
            context.progress("many dense frames", number / (2 * count))
            # Seeds of their own, so that no frame is part of its own truth.
            frame = vctgi.render_frame(prepared, lit.volume, config, seed=1000 + number)
            halves[number % 2] = halves[number % 2] + _diffuse(frame) / count
        mean, noise = _mean_and_noise(halves)
        return _Truth(prepared, lit, mean, noise)

    def compare() -> _Found:
        truth = context.once("sparse, truth", prepare)
        found = _Found([], 0.0, [], [])
        halves = [np.zeros(()), np.zeros(())]
        count = HALF_COUNT[context.quick]
        for seed in range(2 * count):
            context.progress(f"sparsity {sparsity}", seed / (2 * count))
            began = time.perf_counter()
            config = sparse_config(sparsity)
            frame = vctgi.render_frame(truth.prepared, truth.lit.volume, config, seed=seed)
            picture = _diffuse(frame)
            found.seconds.append(time.perf_counter() - began)
            found.single.append(_without(_share(picture - truth.mean, truth.mean), truth.noise))
            found.refined.append(frame.refined_share)
            halves[seed % 2] = halves[seed % 2] + picture / count
        mean, noise = _mean_and_noise(halves)
        whole = _share(mean - truth.mean, truth.mean)
        return replace(found, systematic=_without(whole, math.hypot(noise, truth.noise)))

    return context.once(f"sparse, {sparsity}", compare)


def _diffuse(frame: Frame) -> np.ndarray:
    return np.array(frame.indirect_diffuse, dtype=np.float64)


def _mean_and_noise(halves: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Mean of two independent halves, and the mean relative error that it has."""
    first, second = halves
    return 0.5 * (first + second), _share(0.5 * (first - second), first)


def _without(whole: float, noise: float) -> float:
    """Take noise out of a difference; below its floor nothing is left."""
    return math.sqrt(max(whole**2 - noise**2, 0.0))


def _single(context: StudyContext, sparsity: int) -> Measured:
    return mean_of(_frames(context, sparsity).single)


def _systematic(context: StudyContext, sparsity: int) -> Measured:
    return Measured(value=_frames(context, sparsity).systematic)


def _refined(context: StudyContext, sparsity: int) -> Measured:
    return mean_of(_frames(context, sparsity).refined)


def _seconds(context: StudyContext, sparsity: int) -> Measured:
    """Shortest of the frames after the first, which compiles."""
    return Measured(value=min(_frames(context, sparsity).seconds))
