"""Marches and cones at the ends of their parameters, in glowing fog of one density.

Fog of extinction k that glows with radiance 1 shows 1 - exp(-k s) over the length s, whatever the
steps; the optical depth of a voxel is capped at 6, which is as dense as fog can be.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

import vctgi
from experiments.studies.check import StudyContext
from experiments.studies.stability.case import (
    Limits,
    Outcome,
    StabilityCase,
    energy,
    largest_difference,
    refusal,
)
from experiments.studies.stability.rooms import render, room, settings, standard
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume, pack_volume
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone

VOXEL, FOG_RESOLUTION = 0.5, 16
LENGTH_VOXELS = 3.0
"""Length of the marches, in voxels; well inside the window."""

DEPTH_CAP = 6.0
"""Optical depth of the densest voxel (accuracy.md 4)."""

OPACITIES = (1e-6, 0.5, 0.99, 1.0 - 1e-6, 1.0)

THIN = 1e-6
"""Footprint over distance of a hair-thin ray."""

ORACLE: Limits = (None, 2e-4)
"""Of light between 0 and 1: steps in single precision, and the stop at a transmittance of 1e-4."""

CHANGE = 0.01
CONDITION: Limits = (-1e-4, 1.001)
"""Rounding of light of 1 over the change; below 1, because dense fog shows no more than its own
radiance."""

STEPS = {
    "step of a hundredth of the footprint": (0.3, ConeMarchConfig(step_ratio=0.01)),
    "step of a thousandth of a voxel": (
        THIN,
        ConeMarchConfig(min_step_voxels=1e-3),
    ),
    "step of the whole footprint": (0.3, ConeMarchConfig(step_ratio=1.0)),
    "step of a thousand voxels": (THIN, ConeMarchConfig(min_step_voxels=1e3)),
    "no light let through ends a march": (0.3, ConeMarchConfig(min_transmittance=0.0)),
}
"""Cone ratios and marches."""

RATIOS = {
    "hair-thin cone": THIN,
    "cone of no width": 0.0,
    "cone of half the sphere, less a hair": 2.0 * math.tan(0.5 * (math.pi - 1e-4)),
}


def cases() -> list[StabilityCase]:
    """Return the cases of marches and cones."""
    found = [
        StabilityCase(
            name=f"fog of opacity {opacity:.7g} a voxel",
            expected="what the closed form says, and a condition number of 1 at most",
            why=f"optical depth is capped at {DEPTH_CAP:g}, so that its slope is bounded",
            run=partial(_opacity, opacity=opacity),
            limits={"error": ORACLE, "condition number": CONDITION},
        )
        for opacity in OPACITIES
    ]
    found += [
        StabilityCase(
            name=f"fog by a {name}" if name[0] == "s" else f"fog, {name}",
            expected="what the closed form says",
            why="the march is exact in a medium of one density, and its last step is cut",
            run=partial(_in_fog, ratio=ratio, march=march),
            limits={"error": ORACLE},
        )
        for name, (ratio, march) in STEPS.items()
    ]
    found += [
        StabilityCase(
            name=f"fog by a {name}",
            expected="light and transmittance that sum to 1, both in [0, 1]",
            why="levels and steps follow a footprint that may vanish or pass all bounds",
            run=partial(_in_fog, ratio=ratio, march=ConeMarchConfig()),
            limits={"light and transmittance less 1": ORACLE},
        )
        for name, ratio in RATIOS.items()
    ]
    found += [
        StabilityCase(
            name="apertures a ten-thousandth of those that cover the hemisphere",
            expected="nearly the light of thin rays",
            why="cones become rays, and rays read the finest voxels",
            run=partial(_apertures, scale=1e-4),
            limits={"energy": (0.5, 1.5), "change with the scale": (None, 1e-3)},
        ),
        StabilityCase(
            name="one cone for the hemisphere",
            expected="sound light of the right size",
            why="its aperture is 120 degrees: the coarsest reading that there is",
            run=_one_cone,
            limits={"energy": (0.3, 2.0)},
        ),
        refusal(
            "apertures beyond half the sphere",
            "the tangent of half an aperture turns negative there, and a footprint with it",
            lambda: render(room(), _with_cones(aperture_scale=4.0)),
            "aperture",
        ),
    ]
    refusals: list[tuple[str, str, Callable[[], object], str]] = [
        (
            "step ratio of 0",
            "a march would never end",
            lambda: ConeMarchConfig(step_ratio=0.0),
            "step_ratio",
        ),
        (
            "step ratio above 1",
            "a march would skip voxels",
            lambda: ConeMarchConfig(step_ratio=1.5),
            "step_ratio",
        ),
        (
            "step ratio of NaN",
            "a march would never end",
            lambda: ConeMarchConfig(step_ratio=math.nan),
            "step_ratio",
        ),
        (
            "aperture scale of 0",
            "there are no cones left",
            lambda: DiffuseConesConfig(aperture_scale=0.0),
            "aperture_scale",
        ),
    ]
    found += [refusal(*each) for each in refusals]
    return found


def fog(opacity: float) -> VoxelVolume:
    """Return fog that fills the window, glowing with radiance 1; of an opacity a level-0 voxel."""
    layout = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=VOXEL, level_count=1, resolution=FOG_RESOLUTION
    )
    depth = _depth(opacity)
    alphas, colors = [], []
    for level in layout.levels:
        # What the same extinction is over a coarser voxel.
        share = opacity if level.level == 0 else -math.expm1(-depth * 2.0**level.level)
        count = DIRECTION_COUNT * level.voxel_count
        alphas.append(dr.full(mi.Float, share, count))
        colors.append(dr.zeros(mi.Color3f, count) + share)
    return pack_volume(OpacityClipmap(layout, alphas), EmittanceClipmap(layout, colors, [0.0]))


def _depth(opacity: float) -> float:
    """Optical depth of a voxel, as the recipe caps it."""
    return DEPTH_CAP if opacity >= 1.0 else min(-math.log1p(-opacity), DEPTH_CAP)


def march(opacity: float, ratio: float, config: ConeMarchConfig) -> tuple[float, float]:
    """Return light and transmittance of a cone along x, `LENGTH_VOXELS` long."""
    limited = replace(config, start_offset_voxels=0.0, max_distance_voxels=LENGTH_VOXELS)
    # More than one lane, as every march has.
    apex = dr.zeros(mi.Point3f, 4) + mi.Point3f(-1.0, 0.1, 0.1)
    found = march_cone(
        fog(opacity),
        apex,
        dr.zeros(mi.Vector3f, 4) + mi.Vector3f(1.0, 0.0, 0.0),
        dr.full(mi.Float, ratio, 4),
        dr.full(mi.Float, 1.0, 4),
        limited,
        dr.full(mi.Bool, True, 4),
    )
    dr.eval(found)
    return float(found.radiance[0][0]), float(found.transmittance[0])


def _opacity(_context: StudyContext, opacity: float) -> Outcome:
    light, transmittance = march(opacity, THIN, ConeMarchConfig())
    nudged = opacity * (1.0 - CHANGE)
    # Without the stop at little transmittance, which is a jump.
    whole = ConeMarchConfig(min_transmittance=0.0)
    change = 1.0 - march(nudged, THIN, whole)[0] / march(opacity, THIN, whole)[0]
    return Outcome(
        pictures=[np.array([light, transmittance])],
        numbers={
            "error": abs(light + math.expm1(-_depth(opacity) * LENGTH_VOXELS)),
            "condition number": change / CHANGE,
        },
    )


def _in_fog(_context: StudyContext, ratio: float, march: ConeMarchConfig) -> Outcome:
    light, transmittance = _march(0.3, ratio, march)
    return Outcome(
        pictures=[np.array([light, transmittance])],
        numbers={
            "error": abs(light + math.expm1(-_depth(0.3) * LENGTH_VOXELS)),
            "light and transmittance less 1": abs(light + transmittance - 1.0),
        },
    )


_march = march


def _with_cones(**changes: Any) -> vctgi.RenderConfig:
    config: vctgi.RenderConfig = settings()
    return replace(config, diffuse=replace(config.diffuse, **changes))


def _apertures(context: StudyContext, scale: float) -> Outcome:
    found = render(room(), _with_cones(aperture_scale=scale))
    thinner = render(room(), _with_cones(aperture_scale=0.1 * scale))
    return Outcome(
        pictures=[found, thinner],
        numbers={
            "energy": energy(found, standard(context)),
            "change with the scale": largest_difference(thinner, found),
        },
    )


def _one_cone(context: StudyContext) -> Outcome:
    found = render(room(), _with_cones(cone_count=1))
    return Outcome(pictures=[found], numbers={"energy": energy(found, standard(context))})
