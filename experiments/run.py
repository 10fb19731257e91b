"""One run: a scene rendered by cones and by path tracing, compared, and kept as a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import metrics
import reference
import vctgi
from experiments.errors import InputError
from experiments.noise import noise_floors
from experiments.record import RunResult, keep_record
from experiments.scenes import LoadedScene
from experiments.timing import StageTimer
from reports.record import Record
from vctgi.config import RenderConfig
from vctgi.pipeline import Frame, FrameTally, LitVolume, PreparedScene

BATCH_COUNT = 8
"""Independent batches of a reference: their spread gives the intervals."""

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done, in [0, 1]."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What a run is asked for, apart from the scene."""

    preset: str = "high"
    """Named configuration of the cones."""
    config: RenderConfig | None = None
    """A configuration to use instead of the preset's, whose name is then only a label."""
    reference_spp: int = 512
    """Paths a pixel of the reference, over all its batches."""
    batch_count: int = BATCH_COUNT
    """Independent batches of the reference."""
    seed: int = 0
    """Start of all random numbers."""
    warm_frames: int = 2
    """Frames that are timed, after one that compiles."""
    is_counted: bool = True
    """Whether one more frame is rendered, not timed, that counts what its cones read."""
    cache_directory: Path | None = None
    """Where references are kept."""
    keep: tuple[str, ...] = ()
    """What is kept although the scene does not need it (`vctgi.eliminations`), or "all"."""
    command: str = ""
    """What to type to make the record again."""


@dataclass
class ConeFrame:
    """A picture by voxel cone tracing with what it took."""

    prepared: PreparedScene
    lit: LitVolume
    frame: Frame
    timer: StageTimer


def run_scene(
    loaded: LoadedScene,
    options: RunOptions,
    output: Path,
    variant: str,
    progress: Progress,
    display: metrics.DisplaySettings | None = None,
) -> tuple[Record, Path]:
    """Render a scene both ways, compare, and write the record with its pictures.

    Parameters
    ----------
    loaded
        A scene that passed the checks.
    options
        Preset, samples, seed.
    output
        Folder that gets `records/`.
    variant
        The Mitsuba variant that is set.
    progress
        Told what is being done.
    display
        How the scene is shown; None chooses it from the reference.

    Returns
    -------
    tuple
        The record and its file.
    """
    config = options.config or replace(vctgi.preset(options.preset), keep=options.keep)
    cones = render_cones(loaded, config, options, progress)
    tally = count_samples(cones, config, options) if options.is_counted else None
    truth = reference.render_reference(
        loaded.scene,
        sensor=loaded.sensor_index,
        request=reference_request(options, config),
        cache_directory=options.cache_directory,
        progress=lambda share: progress("path tracing", share),
    )
    progress("comparing", 0.0)
    # Direct light and emission are Mitsuba's on both sides: the same numbers, so that every
    # difference between the two pictures is one of indirect light.
    shared = truth.mean("emission") + truth.mean("direct")
    tests = component_images(cones.frame)
    tests["image"] = tests["indirect"] + shared
    batches = {name: truth.batches(name) for name in tests if name != "image"}
    batches["image"] = batches["indirect"] + shared
    _require_light(batches["image"], loaded.source)
    display = display or metrics.display_settings(batches["image"].mean(axis=0))
    measured = [
        value
        for name in COMPARED
        for value in metrics.measure(tests[name], batches[name], component=name, display=display)
    ]
    result = RunResult(
        loaded=loaded,
        config=config,
        prepared=cones.prepared,
        lit=cones.lit,
        truth=truth,
        tests=tests,
        references={name: values.mean(axis=0) for name, values in batches.items()},
        floors=noise_floors(batches, options.reference_spp),
        surfaces=surface_images(cones.frame),
        measured=measured,
        times=cones.timer.stage_times(),
        tally=tally,
        display=display,
    )
    written = keep_record(result, options, output, variant)
    progress("comparing", 1.0)
    return written


COMPARED = ("image", "indirect", "indirect_diffuse", "indirect_specular")
"""Components that metrics are given for."""


def _require_light(batches: np.ndarray, source: str) -> None:
    """Refuse a picture that shows nothing: there is no brightness to compare at."""
    if not batches.any():
        raise InputError(
            what="the camera sees no light at all",
            where=source,
            remedy="turn it to something lit, or raise the power of the lights",
        )


def reference_request(options: RunOptions, config: RenderConfig) -> reference.ReferenceRequest:
    """Return what is asked of the path tracer: the transport that the cones render."""
    return reference.ReferenceRequest(
        samples_per_pixel=options.reference_spp,
        batch_count=options.batch_count,
        scattering_count=config.scattering_count,
        seed=options.seed,
    )


def render_cones(
    loaded: LoadedScene, config: RenderConfig, options: RunOptions, progress: Progress
) -> ConeFrame:
    """Render one compiling and several warm frames from scratch; keep the last."""
    timer = StageTimer()
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    frame_count = 1 + options.warm_frames
    for number in range(frame_count):
        progress("cone tracing", number / frame_count)
        timer.start_frame()
        prepared = vctgi.prepare_scene(loaded.scene, sensor, config, timer)
        lit = vctgi.light_volume(prepared, config, timer)
        frame = vctgi.render_frame(prepared, lit.volume, config, timer, options.seed)
    progress("cone tracing", 1.0)
    return ConeFrame(prepared, lit, frame, timer)


def count_samples(cones: ConeFrame, config: RenderConfig, options: RunOptions) -> FrameTally:
    """Render the frame once more and return what its cones read."""
    tally = FrameTally()
    vctgi.render_frame(cones.prepared, cones.lit.volume, config, seed=options.seed, tally=tally)
    return tally


def component_images(frame: Frame) -> dict[str, np.ndarray]:
    """Indirect light of a frame as arrays [height, width, 3], by component."""
    diffuse, specular = np.array(frame.indirect_diffuse), np.array(frame.indirect_specular)
    return {
        "indirect": diffuse + specular,
        "indirect_diffuse": diffuse,
        "indirect_specular": specular,
    }


def surface_images(frame: Frame) -> dict[str, np.ndarray]:
    """Albedo and normal [height, width, 3] and depth [height, width] of a frame."""
    return {
        "albedo": np.array(frame.albedo),
        "normal": np.array(frame.normal),
        "depth": np.array(frame.depth)[..., 0],
    }
