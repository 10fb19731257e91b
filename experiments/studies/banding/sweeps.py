"""Phase sweeps of specular cones: B1, all that moves with the phase, and B2, what of it is bands.

The pictures of a sweep differ only in the start phase of all marches. B2 is demodulated from them
(`metrics.moving_bands`), so it needs no reference: what one would take off stands still.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from experiments.studies.accuracy.glossy import RESOLUTION, glossy_view
from experiments.studies.banding.maps import add_spread_map
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.figures import Curve, Point
from metrics.confidence import Estimate
from metrics.display import nits_per_unit
from metrics.display_banding import display_banding_excess
from metrics.luminance import luminance
from metrics.moving_bands import MovingBands, moving_bands, ratio_of_bands
from vctgi.stages.cone_tracing.specular import PhaseNoise, SpecularConesConfig, specular_march
from vctgi.stages.reconstruction.denoising import SpecularFilter, SpecularFilterConfig

ALPHAS = (0.05, 0.1, 0.2)
"""GGX width of the floor."""

STEPS_VOXELS = (0.5, 1.0, 2.0)
"""Steps of the march, in voxels of the level that is read."""

EDGE = 160
"""Pixels along an edge, in the quick study too: bands are counted in tiles of them."""

QUICK_ALPHA = 0.1
PLANTED_STEP = STEPS_VOXELS[-1]
"""Four times the shortest step."""

PHASE_COUNT = 8
PHASE_STEP = 17.0 / 128.0
"""Start phases: spread evenly over a step and, modulo the 16 steps of the noise, over those too."""

TREATMENTS: dict[str, tuple[PhaseNoise, SpecularFilter]] = {
    "off": ("none", "none"),
    "noise": ("blue", "none"),
    "on": ("blue", "bilateral"),
}
"""Noise and filter."""

WAYS = {"off": "no noise, no filter", "noise": "noise", "on": "noise and filter"}

GROUP = "Glossy floor, by step and roughness"
NAMES = {"B1": "All that moves with the phase (B1)", "B2": "Bands alone (B2)"}
LABELS = {"B1": "B1, RMS over the mean light", "B2": "B2, power over the mean light squared"}

LEAST_GAIN = 4.0
"""By how much noise and filter together must lower bands."""

MOST_BANDS = 1.5e-4
"""Largest B2 of the shortest steps without noise and filter; of steps four times as long it is at
least three times that."""

LEAST_OF_PLANTED = 4.0
"""By how much steps four times as long must raise the bands, in power."""

SCENE = "glossy_floor, GGX floor, specular light"


Sweep = tuple[np.ndarray, list[float], np.ndarray, np.ndarray]
"""Pictures [phase, row, column, rgb], their phases, and steps and mask [row, column]."""


def checks() -> list[Check]:
    """Return the checks of all sweeps."""
    return [*_values(), *_ratios(), *_displayed()]


def _displayed() -> list[Check]:
    return [
        Check(
            name=f"B3, alpha {QUICK_ALPHA:g}, steps of {step:g} voxel, {treatment}",
            configuration="first start phase over the mean of all; sees nothing but flats of "
            "equal 10-bit codes, which slopes of light leave no room for",
            scene=SCENE,
            measure=partial(_display, alpha=QUICK_ALPHA, step=step, treatment=treatment),
            goal=0.0,
        )
        for step in STEPS_VOXELS
        for treatment in TREATMENTS
    ]


def _values() -> list[Check]:
    return [
        Check(
            name=f"{name}, alpha {alpha:g}, steps of {step:g} voxel, {treatment}",
            configuration=f"N = {RESOLUTION}, noise {TREATMENTS[treatment][0]}, "
            f"filter {TREATMENTS[treatment][1]}, {PHASE_COUNT} start phases",
            scene=SCENE,
            measure=partial(measure, alpha=alpha, step=step, treatment=treatment),
            limit_high=MOST_BANDS if name == "B2" and step == STEPS_VOXELS[0] else None,
            goal=0.0,
            in_quick=alpha == QUICK_ALPHA,
            is_headline=step == STEPS_VOXELS[0] and treatment == "on",
            points=_points(name, alpha, step, treatment),
        )
        for alpha in ALPHAS
        for step in STEPS_VOXELS
        for treatment in TREATMENTS
        for name, measure in (("B1", _spread), ("B2", _power))
    ]


def _points(name: str, alpha: float, step: float, treatment: str) -> tuple[Point, ...]:
    """Return the places of a number on a curve over steps and on one over roughness."""
    over_step = Curve(
        group=GROUP,
        title=f"{NAMES[name]} by the length of a step, alpha {alpha:g}",
        caption="0 is a picture without bands; intervals are over tiles of the picture.",
        x_label="step of the march, voxels of the level read",
        y_label=LABELS[name],
        is_x_log=True,
        is_y_log=True,
    )
    over_alpha = replace(
        over_step,
        title=f"{NAMES[name]} by roughness, steps of {step:g} voxel",
        x_label="GGX alpha of the floor",
    )
    way = WAYS[treatment]
    return Point(over_step, way, step), Point(over_alpha, way, alpha)


def _ratios() -> list[Check]:
    found = []
    for alpha in ALPHAS:
        scene, is_quick = f"{SCENE}, alpha {alpha:g}", alpha == QUICK_ALPHA
        for short, long in pairwise(STEPS_VOXELS):
            found.append(
                Check(
                    name=f"B2 of steps of {long:g} over {short:g} voxel, alpha {alpha:g}",
                    configuration="no noise, no filter; bands grow with the step",
                    scene=scene,
                    measure=partial(_growth, alpha=alpha, short=short, long=long),
                    limit_low=1.0,
                    in_quick=is_quick,
                )
            )
        found.append(
            Check(
                name=f"planted fault, B2 of steps times 4, alpha {alpha:g}",
                configuration=f"steps of {PLANTED_STEP:g} over {STEPS_VOXELS[0]:g} voxel",
                scene=scene,
                measure=partial(_growth, alpha=alpha, short=STEPS_VOXELS[0], long=PLANTED_STEP),
                limit_low=LEAST_OF_PLANTED,
                in_quick=is_quick,
            )
        )
        for step in STEPS_VOXELS:
            found.append(
                Check(
                    name=f"B2 off over on, alpha {alpha:g}, steps of {step:g} voxel",
                    configuration="neither noise nor filter, over both",
                    scene=scene,
                    measure=partial(_gain, alpha=alpha, step=step),
                    limit_low=LEAST_GAIN,
                    in_quick=is_quick,
                )
            )
    return found


def pictures_of(context: StudyContext, alpha: float, step: float, treatment: str) -> Sweep:
    """Render at every start phase, once."""

    def render() -> Sweep:
        view = glossy_view(context, alpha, EDGE)
        noise, kind = TREATMENTS[treatment]
        march = specular_march(step)
        offsets = [number * PHASE_STEP % 1.0 for number in range(PHASE_COUNT)]
        pictures = []
        for number, offset in enumerate(offsets):
            context.progress("start phases", number / PHASE_COUNT)
            cones = SpecularConesConfig(noise=noise, phase_offset=offset, march=march)
            config = replace(
                view.config, specular=cones, specular_filter=SpecularFilterConfig(kind=kind)
            )
            pictures.append(view.render(config))
        return np.stack(pictures), offsets, *view.cycles(march)

    return context.once(f"pictures, {alpha}, {step}, {treatment}", render)


def sweep(context: StudyContext, alpha: float, step: float, treatment: str) -> MovingBands:
    """Look for what moves in the pictures of all start phases, once."""

    def look() -> MovingBands:
        pictures, offsets, steps, mask = pictures_of(context, alpha, step, treatment)
        light = luminance(pictures)
        group = f"Glossy floor, alpha {alpha:g}, steps of {step:g} voxel"
        if treatment == "off":
            context.shelf.add_picture(group, "Specular light, no noise, no filter", pictures[0])
        add_spread_map(context.shelf, group, WAYS[treatment], light, mask)
        return moving_bands(light, offsets, steps, mask)

    return context.once(f"bands, {alpha}, {step}, {treatment}", look)


def _display(context: StudyContext, alpha: float, step: float, treatment: str) -> Measured:
    """B3 of one picture beyond the mean of all, in which steps have no place of their own."""
    pictures, *_ = pictures_of(context, alpha, step, treatment)
    smooth = pictures.mean(axis=0)
    found = display_banding_excess(
        pictures[0], smooth[None], nits_per_unit=nits_per_unit(smooth), component="specular"
    )
    return Measured(value=found.value)


def _spread(context: StudyContext, alpha: float, step: float, treatment: str) -> Measured:
    """Root of the mean square, so that it is a share of the light."""
    found = sweep(context, alpha, step, treatment).spread
    return Measured(
        value=math.sqrt(found.value),
        low=math.sqrt(max(found.low, 0.0)),
        high=math.sqrt(found.high),
    )


def _power(context: StudyContext, alpha: float, step: float, treatment: str) -> Measured:
    return _measured(sweep(context, alpha, step, treatment).power)


def _growth(context: StudyContext, alpha: float, short: float, long: float) -> Measured:
    """Ratio of two powers of different tiles, with the farthest ends of their intervals."""
    first, second = (sweep(context, alpha, step, "off").power for step in (short, long))
    if not first.value > 0.0:
        return Measured(value=math.inf)
    high = second.high / first.low if first.low > 0.0 else None
    low = max(second.low, 0.0) / first.high
    return Measured(value=second.value / first.value, low=low, high=high)


def _gain(context: StudyContext, alpha: float, step: float) -> Measured:
    off, on = (sweep(context, alpha, step, each) for each in ("off", "on"))
    found = ratio_of_bands(off.tile_powers, on.tile_powers)
    # Bands too weak to tell from none are as strong as their interval allows.
    if found.low <= 0.0 or on.power.low <= 0.0:
        weakest = off.power.value / max(on.power.high, np.finfo(float).tiny)
        return Measured(value=weakest)
    return _measured(found)


def _measured(estimate: Estimate) -> Measured:
    return Measured(value=estimate.value, low=estimate.low, high=estimate.high)
