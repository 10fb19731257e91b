"""What tracing fewer pixels changes: sparse diffuse light against dense.

A frame of few cones is noisy, dense or sparse, so the truth is the mean of many dense frames: what
is measured is all that a sparse frame has wrong beside it, noise and interpolation together. All
look through the same places of each pixel, so that edges and textures are the same. The dense frame
of as many rays stands beside it, whose difference is noise alone. The truth's own noise is known
from its two halves, and taken out in quadrature, which is right for normal errors.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

import vctgi
from experiments.scenes import load_scene
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from vctgi.pipeline import LitVolume, PreparedScene

LIMITS = {1: None, 4: 0.02, 9: 0.03, 16: 0.05}
"""Mean relative difference from dense light that is allowed, by the sparsity."""

LARGEST_REFINED = 0.05
"""Share of the camera rays that may have to trace for themselves in the Cornell box."""

EDGE = (256, 192)
TRUTH_FRAMES = (8, 3)
SEEDS = (4, 2)
"""Picture in pixels, dense frames in each half of the truth, and frames that are compared
with it, in the whole study and in the quick one."""


@dataclass(frozen=True)
class _Truth:
    """The scene, and the mean of many dense frames with the mean relative error that it has."""

    prepared: PreparedScene
    lit: LitVolume
    mean: np.ndarray
    noise: float


@dataclass(frozen=True)
class _Found:
    """Frames of one sparsity against the truth."""

    difference: list[float]
    refined: list[float]
    seconds: list[float]


def checks() -> list[Check]:
    """Return the checks of sparse pixels."""
    found = []
    for sparsity, limit in LIMITS.items():
        frame = "dense frame" if sparsity == 1 else f"every {sparsity}th pixel"
        parts = {"mean relative difference from many dense frames": (_difference, limit)}
        if sparsity > 1:
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
        loaded = load_scene(name, resolution=EDGE[context.quick])
        config = sparse_config(1)
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
        lit = vctgi.light_volume(prepared, config)
        # Seeds of their own, so that no frame is part of its own truth.
        width, height = (int(n) for n in sensor.film().crop_size())
        halves = np.zeros((2, height, width, 3))
        count = TRUTH_FRAMES[context.quick]
        for number in range(2 * count):
            context.progress("many dense frames", number / (2 * count))
            frame = vctgi.render_frame(prepared, lit.volume, config, seed=1000 + number)
            halves[number % 2] += np.array(frame.indirect_diffuse, dtype=np.float64) / count
        first, second = halves
        return _Truth(prepared, lit, 0.5 * (first + second), _share(0.5 * (first - second), first))

    def compare() -> _Found:
        truth = context.once("sparse, truth", prepare)
        found = _Found([], [], [])
        count = SEEDS[context.quick]
        for seed in range(count):
            context.progress(f"sparsity {sparsity}", seed / count)
            began = time.perf_counter()
            config = sparse_config(sparsity)
            frame = vctgi.render_frame(truth.prepared, truth.lit.volume, config, seed=seed)
            picture = np.array(frame.indirect_diffuse, dtype=np.float64)
            found.seconds.append(time.perf_counter() - began)
            whole = _share(picture - truth.mean, truth.mean)
            found.difference.append(math.sqrt(max(whole**2 - truth.noise**2, 0.0)))
            found.refined.append(frame.refined_share)
        return found

    return context.once(f"sparse, {sparsity}", compare)


def _difference(context: StudyContext, sparsity: int) -> Measured:
    return mean_of(_frames(context, sparsity).difference)


def _refined(context: StudyContext, sparsity: int) -> Measured:
    return mean_of(_frames(context, sparsity).refined)


def _seconds(context: StudyContext, sparsity: int) -> Measured:
    """Shortest of the frames after the first, which compiles."""
    return Measured(value=min(_frames(context, sparsity).seconds))
