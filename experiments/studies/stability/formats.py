"""Storage formats against single precision, at the ends of what they hold; and the largest size."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import mitsuba as mi
import numpy as np

import vctgi
from experiments.studies.check import StudyContext
from experiments.studies.stability.case import (
    Limits,
    Outcome,
    StabilityCase,
    energy,
    mean_difference,
    refusal,
)
from experiments.studies.stability.rooms import RADIANCE, lamp, render, room, settings, standard
from vctgi.clipmap.formats import MIN_HALF
from vctgi.clipmap.storage import StorageConfig, bytes_per_voxel

AGREEMENT: dict[str, Limits] = {
    "float16": (None, 1e-3),
    "rgb10a2": (None, 0.02),
    "rgba8": (None, 0.1),
    "srgb8": (None, 0.03),
    "texture16": (None, 1e-3),
}
"""Mean difference from single precision: each format's own bound (`vctgi/clipmap/formats.py`),
where linear bytes cannot tell most of a dim wall from the steps of its lamp's surroundings."""

FACTORS = (1e-8, 1.0, 1e8)

MAX_LEVELS, LARGEST = 8, 256

FADING: Limits = (0.8, 1.2)
"""Energy where the walls lie in the rim of the finest window, in which it fades into the next."""


def cases() -> list[StabilityCase]:
    """Return the cases of storage."""
    found = [
        StabilityCase(
            name=f"{name}, lamp {factor:g} times as bright",
            expected="the picture of single precision, within the format's steps",
            why="eleven bits of every number are kept"
            if name == "float16"
            else "a scale is chosen by the brightest voxel, so that steps follow the light",
            run=partial(_stored, name=name, factor=factor),
            limits={"mean difference": limit},
            goals={"mean difference": 0.0},
        )
        for name, limit in AGREEMENT.items()
        for factor in FACTORS
        if (name, factor) not in (("float16", 1e8), ("float16", 1e-8))
        and (name != "texture16" or _is_gpu())
    ]
    found += [
        refusal(
            "float16, light above 65504",
            "half precision has no code for it, and infinity would spread over the picture",
            lambda: _render_stored("float16", 1e8),
            "65504",
        ),
        StabilityCase(
            name="float16, light below its smallest number",
            expected="darkness where light is less than the smallest step, as documented",
            why=f"half precision has steps of {MIN_HALF:.2g} there, and rounds to the nearest",
            run=_underflow,
            limits={"largest difference over a step": (0.0, 1.0)},
        ),
        refusal(
            "rgb10a2, scale below the light",
            "what is above the scale has no code",
            lambda: _render_stored("rgb10a2", 1.0, scale=1e-6),
            "scale",
        ),
        StabilityCase(
            name=f"{MAX_LEVELS} clip levels of 32^3",
            expected="the light of the room",
            why="coarse levels hold the room in a voxel or less, and cones need few of them",
            run=_many_levels,
            limits={"energy": FADING},
            in_quick=False,
        ),
    ]
    if _is_gpu():
        found.append(_largest())
    return found


def _is_gpu() -> bool:
    return (mi.variant() or "").startswith("cuda")


def _largest() -> StabilityCase:
    """Return the case of the most voxels that there are.

    Opacity and emittance of six directions in single precision take 96 bytes a voxel while they are
    made, and as many once they are stored: 8 x 256^3 voxels are 26 GB, so a GPU has to hold them.
    """
    return StabilityCase(
        name=f"{MAX_LEVELS} clip levels of {LARGEST}^3",
        expected="the light of the room, in the memory that the format says",
        why="indices of voxels pass 2^30, and those of their bytes 2^33",
        run=_most_voxels,
        limits={"energy": FADING, "stored bytes over those of the format": (0.0, 1.0)},
        in_quick=False,
    )


def _settings(name: Any, scale: float | None = None) -> vctgi.RenderConfig:
    config: vctgi.RenderConfig = settings()
    return replace(config, storage=StorageConfig(format=name, scale=scale))


def _render_stored(name: str, factor: float, scale: float | None = None) -> np.ndarray:
    return render(room(lamp=lamp(RADIANCE * factor)), _settings(name, scale))


def _plain(context: StudyContext, factor: float) -> np.ndarray:
    return context.once(
        f"stability, room {factor:g}", lambda: render(room(lamp=lamp(RADIANCE * factor)))
    )


def _stored(context: StudyContext, name: str, factor: float) -> Outcome:
    found = _render_stored(name, factor)
    truth = _plain(context, factor)
    return Outcome(pictures=[found], numbers={"mean difference": mean_difference(found, truth)})


def _underflow(context: StudyContext) -> Outcome:
    found = _render_stored("float16", 1e-8)
    truth = _plain(context, 1e-8)
    apart = float(np.abs(found - truth).max()) / MIN_HALF
    return Outcome(pictures=[found], numbers={"largest difference over a step": apart})


def _many_levels(context: StudyContext) -> Outcome:
    config: vctgi.RenderConfig = settings()
    config = replace(config, clipmap=replace(config.clipmap, level_count=MAX_LEVELS))
    found = render(room(), config)
    return Outcome(pictures=[found], numbers={"energy": energy(found, standard(context))})


def _most_voxels(context: StudyContext) -> Outcome:
    config = _settings("float32")
    clipmap = replace(
        config.clipmap,
        resolution=LARGEST,
        finest_voxel_size=2.6 / LARGEST,
        level_count=MAX_LEVELS,
    )
    config = replace(config, clipmap=clipmap)
    scene: mi.Scene = mi.load_dict({"type": "scene", **room()})
    prepared = vctgi.prepare_scene(scene, scene.sensors()[0], config)
    volume = vctgi.light_volume(prepared, config).volume
    frame = vctgi.render_frame(prepared, volume, config)
    found = np.array(frame.indirect_diffuse)
    most = bytes_per_voxel(config.storage) * volume.layout.voxel_count
    return Outcome(
        pictures=[found],
        numbers={
            "energy": energy(found, standard(context)[..., :3]),
            "stored bytes over those of the format": volume.byte_count / most,
        },
    )
