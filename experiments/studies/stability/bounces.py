"""Many scatterings between walls that reflect nothing, much, and all of it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import mitsuba as mi
import numpy as np

import vctgi
from experiments.studies.check import StudyContext
from experiments.studies.stability.case import EXACT, Limits, Outcome, StabilityCase
from experiments.studies.stability.rooms import diffuse, room, settings, walls

COUNT = 24
"""Scatterings from voxel to voxel."""

GROWTH: Limits = (0.0, 1.0)
"""Of the light of a scattering over that of the one before it."""

ALBEDOS = (0.5, 0.9, 0.99, 1.0)


def cases() -> list[StabilityCase]:
    """Return the cases of many scatterings."""
    found = [
        StabilityCase(
            name=f"{COUNT} scatterings at albedo {albedo:g}",
            expected="each one dimmer than the one before, by the albedo at least",
            why="a closed room cannot gain light, whatever its voxels make of it",
            run=partial(_scattered, albedo=albedo),
            limits={
                "growth factor": (GROWTH[0], albedo),
                "light over the closed form": (None, 1.0),
            },
            goals={"growth factor": albedo, "light over the closed form": 1.0},
            in_quick=albedo in (0.5, 1.0),
        )
        for albedo in ALBEDOS
    ]
    found.append(
        StabilityCase(
            name=f"{COUNT} scatterings at albedo 0",
            expected="darkness, and an end after the first",
            why="nothing is left to scatter",
            run=_black,
            limits={"light": EXACT, "scatterings": (1.0, 1.0)},
        )
    )
    return found


def _config() -> vctgi.RenderConfig:
    config: vctgi.RenderConfig = settings()
    return replace(
        config,
        clipmap=replace(config.clipmap, resolution=16, finest_voxel_size=2.6 / 16),
        scattering_count=COUNT + 2,
        bounces=replace(config.bounces, min_bounce_share=0.0),
    )


def _fluxes(albedo: float) -> tuple[list[float], np.ndarray]:
    """Return the flux after each scattering, and a picture."""
    parts = room(**walls(bsdf=diffuse(albedo)))
    scene: mi.Scene = mi.load_dict({"type": "scene", **parts})
    config = _config()
    prepared = vctgi.prepare_scene(scene, scene.sensors()[0], config)
    lit = vctgi.light_volume(prepared, config)
    frame = vctgi.render_frame(prepared, lit.volume, config)
    return lit.bounce_fluxes, np.array(frame.indirect_diffuse)


def _scattered(_context: StudyContext, albedo: float) -> Outcome:
    fluxes, picture = _fluxes(albedo)
    series = float(len(fluxes)) if albedo == 1.0 else (1.0 - albedo ** len(fluxes)) / (1.0 - albedo)
    return Outcome(
        pictures=[picture, np.array(fluxes)],
        numbers={
            "growth factor": max(after / before for before, after in itertools.pairwise(fluxes)),
            "light over the closed form": sum(fluxes) / fluxes[0] / series,
        },
    )


def _black(_context: StudyContext) -> Outcome:
    fluxes, picture = _fluxes(0.0)
    return Outcome(
        pictures=[picture],
        numbers={"light": float(picture.max()), "scatterings": float(len(fluxes))},
    )
