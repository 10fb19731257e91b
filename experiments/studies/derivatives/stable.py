"""Derivatives at the ends of what parameters can be, by closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.derivatives.measure import Picture
from experiments.studies.derivatives.room import SCENE_NAMES, derivative_room

RADIANCES = (1e-8, 1e8)
"""Factors on the radiance of the lamp."""

LINEAR = 1e-3
"""Rounding of single precision; light is linear."""

APERTURES = (1e-6, 0.01, 3.1, 3.14159)
"""Full apex angles, radians, from a ray to half of space."""

EXPONENTS = (1e-3, 30.0, 1000.0)
"""Exponents of the opacity: from hardly any to walls of which each voxel is opaque."""

SHORT_STEPS = (0.25, 0.05)
"""Steps in voxels, about as long wherever they are: the second takes hundreds for each cone."""

ALBEDO, SCATTERINGS = 0.99, 6


def checks() -> list[Check]:
    """Return the checks of extreme values."""
    scene = "Cornell box with a rough metal ball"

    def finite(name: str, measure: Callable[[StudyContext], Measured]) -> Check:
        how = "reverse mode; finite, no limit"
        return Check(name=name, configuration=how, scene=scene, measure=measure, in_quick=False)

    return [
        *(
            Check(
                name=f"lamp of {factor:g} times its radiance, derivative by it over the mean",
                configuration="reverse mode; light is linear",
                scene=scene,
                measure=partial(_lamp, factor=factor),
                limit_low=1.0 - LINEAR,
                limit_high=1.0 + LINEAR,
                goal=1.0,
                in_quick=False,
            )
            for factor in RADIANCES
        ),
        *(
            finite(
                f"cones of {aperture:g} radians, derivative by their share over the mean",
                partial(_aperture, aperture=aperture),
            )
            for aperture in APERTURES
        ),
        *(
            finite(
                f"opacity exponent of {exponent:g}, derivative by its share over the mean",
                partial(_exponent, exponent=exponent),
            )
            for exponent in EXPONENTS
        ),
        Check(
            name=f"steps of {SHORT_STEPS[1]:g} voxels, derivative by the cones' share over that "
            f"with {SHORT_STEPS[0]:g}",
            configuration="reverse mode by all apertures; no limit, the picture changes, too",
            scene=scene,
            measure=_short_steps,
            goal=1.0,
            in_quick=False,
        ),
        Check(
            name=f"walls of albedo {ALBEDO:g}, derivative by its share over the mean",
            configuration=f"reverse mode, {SCATTERINGS} scatterings; light of n of them goes with "
            "the n-th power, fewer where other surfaces take part",
            scene=scene,
            measure=_feedback,
            limit_low=0.0,
            limit_high=float(SCATTERINGS),
            in_quick=False,
        ),
    ]


def _lamp(context: StudyContext, factor: float) -> Measured:
    room = derivative_room(context)
    key = SCENE_NAMES["radiance of the lamp"]
    picture = room.with_scene(key, room.config)
    held = room.scene_parameters[key]
    found = _share(picture, type(held)(held) * factor)
    room.restore()
    return found


def _aperture(context: StudyContext, aperture: float) -> Measured:
    room = derivative_room(context)
    held = room.cones()["apertures"]
    return _share(room.with_cones("apertures"), type(held)(held * 0.0 + aperture))


def _exponent(context: StudyContext, exponent: float) -> Measured:
    room = derivative_room(context)
    return _share(room.with_cones("opacity_exponent"), dr.opaque(mi.Float, exponent))


def _short_steps(context: StudyContext) -> Measured:
    room = derivative_room(context)
    found = []
    for step in SHORT_STEPS:

        def picture(apertures: mi.Float, step: float = step) -> mi.Float:
            lanes = {"min_step_voxels": step, "step_ratio": STEP_GROWTH * step}
            numbers = {name: dr.opaque(mi.Float, value) for name, value in lanes.items()}
            return room.numbers({"apertures": apertures, **numbers})

        found.append(_share(picture, room.cones()["apertures"]).value)
    return Measured(value=found[1] / found[0], note=f"{found[1]:.4g} over {found[0]:.4g}")


STEP_GROWTH = 0.5
"""Steps over the shortest one where a cone is as wide as a voxel."""


def _feedback(context: StudyContext) -> Measured:
    room = derivative_room(context)
    key = SCENE_NAMES["albedo of the walls"]
    config = replace(room.config, scattering_count=SCATTERINGS, samples_per_pixel=1)
    held = room.scene_parameters[key]
    found = _share(room.with_scene(key, config), type(held)(held) * 0.0 + ALBEDO)
    room.restore()
    return found


def _share(picture: Picture, start: Any) -> Measured:
    """Return the derivative by a share that all values have in common, over the mean picture."""
    share = dr.opaque(mi.Float, 0.0)
    dr.enable_grad(share)
    numbers = picture(start * (1.0 + share))
    mean = float(np.mean(np.array(numbers, dtype=np.float64)))
    dr.backward(numbers * (1.0 / dr.width(numbers)))
    return Measured(value=float(dr.grad(share)[0]) / mean)
