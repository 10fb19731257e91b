"""Pictures and references of the Cornell box that are rendered once, and drawn from ever after."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, cast

import mitsuba as mi
import numpy as np

import reference
import vctgi
from experiments.machine import BackendName, describe_machine
from experiments.scenes import load_scene
from experiments.studies.check import StudyContext
from experiments.timing import StageTimer
from reports.record import ImageFile, Machine, write_image

SCENE, PRESET, STAGE = "cornell_box", "medium", "diffuse cones"
"""Scene and preset of the gate, and the stage whose time it bounds."""

SCATTERINGS: Final = 2
"""Of the light that is compared."""

PIXELS = (64, 32)
BATCH_SPP = (3072, 768)
BATCHES = (8, 10)
FRAMES = (24, 12)
"""Edge of the picture, paths a pixel of a batch, batches of each of the references, and frames of
other random numbers, in the whole study and in the quick one."""

SAMPLES: Final = 64
"""Camera rays a pixel of each frame, those of this project's own gate."""

REFERENCE_SEEDS, FIRST_FRAME_SEED = (0, 7000), 100
"""Starts of random numbers; the first reference is that of this project's own gate, which is
rendered once for both."""


@dataclass(frozen=True)
class Pool:
    """What was rendered.

    Attributes
    ----------
    frames
        Indirect light by cones [frame, y, x, rgb], each of another seed.
    images
        The file of each frame, below `folder`.
    times
        Milliseconds of the stage in each frame.
    batches
        Indirect light by paths [batch, y, x, rgb], each of another seed.
    batch_spp
        Paths a pixel of a batch.
    machine
        What all of it was rendered on.
    folder
        Where the files are.
    """

    frames: np.ndarray
    images: list[dict[str, ImageFile]]
    times: np.ndarray
    batches: np.ndarray
    batch_spp: int
    machine: Machine
    folder: Path


@contextmanager
def rendered_pool(context: StudyContext) -> Iterator[Pool]:
    """Render all that is drawn from; the files of the frames are gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="vctgi-gates-") as name:
        folder = Path(name)
        frames, times = _frames(context)
        images = [
            {"indirect": write_image(folder / f"frame{index}" / "indirect.exr", frame, "indirect")}
            for index, frame in enumerate(frames)
        ]
        yield Pool(
            frames=frames,
            images=images,
            times=times,
            batches=_batches(context),
            batch_spp=BATCH_SPP[context.quick],
            machine=describe_machine(cast(BackendName, mi.variant())),
            folder=folder,
        )


def _batches(context: StudyContext) -> np.ndarray:
    """Path-trace all batches; finished ones are kept, so that a run which was stopped goes on."""
    edge, count = PIXELS[context.quick], BATCHES[context.quick]
    loaded = load_scene(SCENE, resolution=(edge, edge))
    found = []
    for seed in REFERENCE_SEEDS:
        truth = reference.render_reference(
            loaded.scene,
            sensor=loaded.sensor_index,
            request=reference.ReferenceRequest(
                samples_per_pixel=count * BATCH_SPP[context.quick],
                batch_count=count,
                scattering_count=SCATTERINGS,
                seed=seed,
            ),
            cache_directory=reference.default_cache_directory(),
            progress=lambda share: context.progress("path tracing", share),
        )
        found.append(truth.batches("indirect"))
    return np.concatenate(found)


def _frames(context: StudyContext) -> tuple[np.ndarray, np.ndarray]:
    """Render frames from scratch, each with other random numbers, and time the stage."""
    edge, count = PIXELS[context.quick], FRAMES[context.quick]
    loaded = load_scene(SCENE, resolution=(edge, edge))
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    config = replace(vctgi.preset(PRESET), samples_per_pixel=SAMPLES)
    assert config.scattering_count == SCATTERINGS, "cones and paths carry the same light"
    found, times = [], []
    for number in range(-1, count):
        context.progress("cone tracing", max(number, 0) / count)
        timer = StageTimer()
        # The clock takes the first frame for a warm-up, which is the pass with number -1 here.
        timer.start_frame()
        timer.start_frame()
        prepared = vctgi.prepare_scene(loaded.scene, sensor, config, timer)
        lit = vctgi.light_volume(prepared, config, timer)
        frame = vctgi.render_frame(
            prepared, lit.volume, config, timer, FIRST_FRAME_SEED + max(number, 0)
        )
        if number < 0:
            continue
        found.append(np.array(frame.indirect_diffuse) + np.array(frame.indirect_specular))
        times.append(next(each.median_ms for each in timer.stage_times() if each.stage == STAGE))
    return np.stack(found), np.array(times)
