"""Rows that hold both modes to differences, and say what is left where they cannot agree.

If the mean picture has no jumps in a parameter, its difference over a step is the mean of its
derivative over the same step, for each seed of the phases by itself: what is left of the one less
the other is light that appears or vanishes at once, a bias of derivatives. What the derivative at
the middle of the step differs by besides is noise, which goes with more seeds.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.derivatives.measure import by_reverse_mode, disagreement
from experiments.studies.derivatives.room import POINTS, SCENE_NAMES, derivative_room
from experiments.studies.derivatives.slopes import (
    MOST_SEEDS,
    SEEDS,
    STEPS,
    TABLE,
    Place,
    Way,
    first_seed_count,
    picture_at,
    slopes,
    tabulate,
)
from reports.study_figures import Bounded

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

BOUNCES = "albedo of the walls, three scatterings"

ROUGHNESS = "roughness of the ball"

QUICK = ("aperture_scale", "opacity_exponent", "radiance of the lamp")
"""Those of the quick version."""

LIMITS: dict[Way, float] = {"fine": 0.05, "coarse": 0.15}
"""How far a derivative may be off, relative to the differences of these steps."""

ENDS = (1e-4, 0.05)
"""Transmittances below which cones end: that of the presets, and one that saves steps."""

ENDING = ("aperture_scale", "step_ratio")
"""Parameters for which that is compared with cones that do not end before the voxels do."""

BOTH: tuple[Way, Way] = ("forward", "reverse")

INNER = 4
"""Places in a step at which derivatives are taken for their mean."""


def checks(scene: str) -> list[Check]:
    """Return the checks of agreement, parameter by parameter."""
    found = []
    for name in (*CONE_NAMES, *SCENE_NAMES, BOUNCES):
        pairs: list[tuple[Way, Way]] = [(mode, "fine") for mode in BOTH]
        if name != BOUNCES:
            pairs.append(("reverse", "coarse"))
        found += [
            Check(
                name=f"{name}, {mode} mode, off differences of step {STEPS[step]:g}",
                configuration=f"worst of {len(POINTS)} points, jittered phases, 16 cones, "
                f"{SEEDS[0]} seeds, up to {MOST_SEEDS} where the interval holds the limit",
                scene=scene,
                measure=partial(_worst, name=name, mode=mode, step=step),
                limit_high=LIMITS[step],
                goal=0.02 if step == "fine" else None,
                in_quick=name in QUICK,
            )
            for mode, step in pairs
        ]
    found += [
        Check(
            name=f"{place.name}, bias by jumps{_words(place)}: differences of step "
            f"{STEPS['coarse']:g} off the mean of derivatives over it",
            configuration=f"reverse mode at {INNER} places of the step, {SEEDS[0]} seeds",
            scene=scene,
            measure=partial(_jumps, place=place),
            limit_high=LIMITS["coarse"] if place.least is None else None,
            goal=0.0,
            in_quick=False,
        )
        for place in (
            *(Place(name) for name in (*CONE_NAMES, ROUGHNESS)),
            *(Place(name, least=ENDS[1]) for name in ENDING),
        )
    ]
    found += [
        Check(
            name=f"{name}, bias by the hard exit at transmittance {least:g}",
            configuration=f"reverse mode, off that of cones that never end early; {SEEDS[0]} seeds",
            scene=scene,
            measure=partial(_bias_of_ending, name=name, least=least),
            goal=0.0,
            in_quick=False,
        )
        for name in ENDING
        for least in ENDS
    ]
    return found


def _words(place: Place) -> str:
    return "" if place.least is None else f" where cones end at transmittance {place.least:g}"


def _worst(context: StudyContext, name: str, mode: Way, step: Way) -> Measured:
    """Return the largest disagreement of all points."""
    factors = (1.0,) if context.quick else POINTS
    worst = None
    for number, factor in enumerate(factors):
        context.progress(f"{name}, {mode}", number / len(factors))
        found = _off(context, Place(name, factor), mode, step)
        if worst is None or found.value > worst.value:
            worst = found
    assert worst is not None, "there are points"
    return worst


def _off(context: StudyContext, place: Place, mode: Way, step: Way) -> Measured:
    """Return a disagreement from as many seeds as tell it from its limit."""
    count = first_seed_count(context)
    while True:
        mean, found, wanted = (slopes(context, place, each, count) for each in ("mean", mode, step))
        off = disagreement(found, wanted, mean)
        if off.low is None or off.high is None:
            is_decided = True
        else:
            is_decided = off.high <= LIMITS[step] or off.low > LIMITS[step]
        if is_decided or count >= MOST_SEEDS:
            break
        count *= 2
    tabulate(context, place, (mode, step))
    note = "" if count == 1 else f"times {place.factor:g}, {count} seeds"
    return Measured(value=off.value, low=off.low, high=off.high, note=note)


def _jumps(context: StudyContext, place: Place) -> Measured:
    """Return what a difference has beside the mean of the derivative over its step."""
    count, step = first_seed_count(context), STEPS["coarse"]
    room = derivative_room(context)
    shares = step * ((np.arange(INNER) + 0.5) * (2.0 / INNER) - 1.0)
    means = []
    for seed in range(count):
        context.progress(f"{place.name}, jumps", seed / count)
        picture, start = picture_at(room, place, seed)
        means.append(np.mean([by_reverse_mode(picture, start, float(each)) for each in shares]))
    whole, wanted = slopes(context, place, "mean", count), slopes(context, place, "coarse", count)
    off = disagreement(np.array(means), wanted, whole)
    if place.least is None and place.name in CONE_NAMES:
        bias = Bounded(value=off.value, low=off.low, high=off.high)
        context.shelf.add_cells(TABLE, place.line, {"bias": bias})
    return off


def _bias_of_ending(context: StudyContext, name: str, least: float) -> Measured:
    """Cones that end early do so at another step when they are wider: a jump without derivative."""
    count = first_seed_count(context)
    ending, endless = (
        slopes(context, Place(name, least=each), "reverse", count) for each in (least, 0.0)
    )
    return disagreement(ending, endless, slopes(context, Place(name), "mean", count))
