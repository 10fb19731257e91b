"""Study "derivatives": whether derivatives of a picture are right, and what they cost.

Each parameter is moved by shares of itself, and the mean picture followed. Both modes are compared
to central differences of a relative step of 0.0001, and reverse mode to those of 0.01, over which
the picture has many kinks: wherever a sample passes from one voxel to the next.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.derivatives import cost, placed, prb, stable
from experiments.studies.derivatives.measure import (
    MODES,
    Picture,
    by_differences,
    disagreement,
    mean_picture,
    moved,
)
from experiments.studies.derivatives.room import (
    POINTS,
    SCENE_NAMES,
    DerivativeRoom,
    derivative_room,
)
from reports.study_figures import Definition

CONE_NAMES = (
    "aperture_scale",
    "apertures",
    "weights",
    "elevations",
    "step_ratio",
    "min_step_voxels",
    "start_offset_voxels",
    "level_bias",
    "pull_back_voxels",
    "opacity_exponent",
    "specular_aperture_scale",
)
"""Parameters of the cones that are measured."""

QUICK = ("aperture_scale", "opacity_exponent", "radiance of the lamp")
"""Those of the quick version."""

ENDS = (1e-4, 0.05)
"""Transmittances below which cones end: that of the presets, and one that saves steps."""

FINE, COARSE = 1e-4, 1e-2
"""Relative steps of the differences."""

LIMITS = {FINE: 0.05, COARSE: 0.15}
"""How far a derivative may be off, relative to the differences of these steps."""

SCENE = (
    "Cornell box with a rough metal ball, 48 x 48 pixels, 16 rays each, in the quick version one"
)


DEFINITIONS = (
    Definition(
        name="off differences",
        formula="|AD - D| / max(|D|, 0.02 mean): of the mean picture, by the share by which the "
        "values become larger, each by another; D the central difference",
        source="experiments/studies/derivatives/measure.py; worst of three points",
    ),
    Definition(
        name="cosine with prb's",
        formula="mean <v_i, r_j> / sqrt(<v_1, v_2> <r_1, r_2>); v derivatives by cones, r by prb, "
        "of a share of the parameter, two independent pictures each",
        source="experiments/studies/derivatives/prb.py",
    ),
    Definition(
        name="squared difference from prb's, over its square",
        formula="<v_1 - r_1, v_2 - r_2> / <r_1, r_2>",
        source="experiments/studies/derivatives/prb.py",
    ),
)


def checks() -> list[Check]:
    """Return the checks of derivatives."""
    found = []
    for name in (*CONE_NAMES, *SCENE_NAMES):
        for mode in MODES:
            for step in (FINE, COARSE) if mode == "reverse" else (FINE,):
                found.append(
                    Check(
                        name=f"{name}, {mode} mode, off differences of step {step:g}",
                        configuration=f"worst of {len(POINTS)} points, jittered phases, 16 cones",
                        scene=SCENE,
                        measure=partial(_off, name=name, mode=mode, step=step),
                        limit_high=LIMITS[step],
                        goal=0.02 if step == FINE else None,
                        in_quick=name in QUICK,
                    )
                )
    bounces = "albedo of the walls, three scatterings"
    found += [
        Check(
            name=f"{bounces}, {mode} mode, off differences of step {FINE:g}",
            configuration="scattering_count 3",
            scene=SCENE,
            measure=partial(_off, name=bounces, mode=mode, step=FINE),
            limit_high=LIMITS[FINE],
            goal=0.02,
            in_quick=False,
        )
        for mode in MODES
    ]
    found += [
        Check(
            name=f"bias where cones end at transmittance {least:g}: aperture_scale",
            configuration=f"reverse mode, off differences of step {COARSE:g}; a known bias",
            scene=SCENE,
            measure=partial(_bias_of_ending, least=least),
            goal=0.0,
            in_quick=False,
        )
        for least in ENDS
    ]
    return found + stable.checks() + placed.checks() + prb.checks() + cost.checks(SCENE)


def _bias_of_ending(context: StudyContext, least: float) -> Measured:
    """Cones that end early do so at another step when they are wider: a jump without derivative."""
    room = derivative_room(context)
    diffuse = room.config.diffuse
    march = replace(diffuse.march, min_transmittance=least)
    config = replace(room.config, diffuse=replace(diffuse, march=march))

    def picture(values: Any) -> Any:
        return room.numbers({"aperture_scale": values}, config)

    start = room.cones()["aperture_scale"]
    found = MODES["reverse"](picture, start)
    wanted = by_differences(picture, start, COARSE)
    return Measured(value=disagreement(found, wanted, mean_picture(picture, moved(start, 0.0))))


def _picture(room: DerivativeRoom, name: str) -> tuple[Picture, Any]:
    """Return the picture as a function of a parameter, and where the parameter is."""
    if name in CONE_NAMES:
        return room.with_cones(name), room.cones()[name]
    config = room.config
    if name.endswith("three scatterings"):
        config = replace(config, scattering_count=3)
        name = name.partition(",")[0]
    key = SCENE_NAMES[name]
    held = room.scene_parameters[key]
    return room.with_scene(key, config), type(held)(held)


def _off(context: StudyContext, name: str, mode: str, step: float) -> Measured:
    room = derivative_room(context)
    picture, start = _picture(room, name)
    worst = 0.0
    factors = (1.0,) if context.quick else POINTS
    for number, factor in enumerate(factors):
        context.progress(f"{name}, {mode}", number / len(factors))
        at = _scaled(start, factor)
        mean = context.once(
            f"derivatives, mean, {name}, {factor}", partial(mean_picture, picture, moved(at, 0.0))
        )
        found = context.once(
            f"derivatives, {mode}, {name}, {factor}", partial(MODES[mode], picture, at)
        )
        wanted = context.once(
            f"derivatives, differences, {name}, {factor}, {step}",
            partial(by_differences, picture, at, step),
        )
        worst = max(worst, disagreement(found, wanted, mean))
    return Measured(value=worst)


def _scaled(start: Any, factor: float) -> Any:
    """Return values times a factor."""
    kind = type(start)
    return kind(np.float32(np.array(start, dtype=np.float64) * factor))
