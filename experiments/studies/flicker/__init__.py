"""Study "flicker": whether the light of surfaces holds still while the eye moves.

See `metrics/flicker.py` for the measures: change along exact motion vectors beyond the truth's; and
`metrics/flicker_parts.py` for the parts of it that another seed changes, and that none does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from experiments.scenes import scene_file_name
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.figures import Point
from experiments.studies.flicker.definitions import DEFINITIONS as DEFINITIONS
from experiments.studies.flicker.maps import add_flicker_maps
from experiments.studies.flicker.names import OVER_SPARSITY, SCENE, configuration, name_of
from experiments.studies.flicker.parts import part_checks
from experiments.studies.flicker.sequences import PATHS, SPARSITIES, Sequence, sequence, truth_of
from experiments.studies.noise import require_told_apart
from metrics.energy import energy_ratio
from metrics.flicker import Motion, changes, flicker, flicker_rms
from metrics.measurement import Measurement

Measure = Callable[[np.ndarray, np.ndarray, Motion], Measurement]


def _energy(frames: np.ndarray, truth: np.ndarray, _motion: Motion) -> Measurement:
    rows = (-1, truth.shape[3], 3)
    return energy_ratio(frames.reshape(rows), truth.reshape(len(truth), *rows))


RMS = "RMS change beyond the truth's"

MEASURES: dict[str, Measure] = {
    "mean change beyond the truth's": flicker,
    RMS: flicker_rms,
    "energy": _energy,
}
"""What is measured of each sequence."""

ROUNDING = 1e-3
"""Relative, of a change in single precision."""

WAYS = {False: "single frames", True: "accumulated"}


def checks() -> list[Check]:
    """Return the checks of flicker."""
    found = []
    for sparsity in SPARSITIES:
        name, base = name_of(sparsity), configuration(sparsity)
        for has_history in (False, True):
            way = f"{name}, accumulated" if has_history else name
            found += [
                Check(
                    name=f"{way}, {measure}",
                    configuration=base + (", accumulate_frame" if has_history else ""),
                    scene=SCENE,
                    measure=partial(_measure, name=measure, which=(sparsity, has_history)),
                    goal=1.0 if measure == "energy" else 0.0,
                    is_headline=measure == RMS,
                    points=(Point(OVER_SPARSITY, WAYS[has_history], sparsity),)
                    if measure == RMS
                    else (),
                )
                for measure in MEASURES
            ]
        found.append(
            Check(
                name=f"{name}, RMS change that accumulation leaves",
                configuration=f"{base}, accumulate_frame over single frames",
                scene=SCENE,
                measure=partial(_left, sparsity=sparsity),
                limit_high=1.0,
                goal=0.0,
            )
        )
        found.append(
            Check(
                name=f"planted fault, history thrown away, {name}, RMS change that is left",
                configuration=f"{base}, accumulate_frame without history over single frames",
                scene=SCENE,
                measure=partial(_left_by_forgotten, sparsity=sparsity),
                limit_low=1.0 - ROUNDING,
            )
        )
    return [*found, *part_checks()]


def _measure(context: StudyContext, name: str, which: tuple[int, bool]) -> Measured:
    slide, truth = sequence(context), truth_of(context)
    require_told_apart(slide.frames[which], truth, PATHS, "the reference of the frames")
    _draw(context, slide, truth)
    found = MEASURES[name](slide.frames[which], truth, slide.motion)
    return Measured(value=found.value, low=found.low, high=found.high)


def _draw(context: StudyContext, found: Sequence, truth: np.ndarray) -> None:
    group = "Cornell box" if context.scene is None else scene_file_name(Path(context.scene))
    draw = partial(add_flicker_maps, context.shelf, group, found.frames, truth, found.motion)
    context.once("flicker maps", draw)


def _left(context: StudyContext, sparsity: int) -> Measured:
    """Own change of accumulated over single frames: without the truth, whose noise both share."""
    return _change_over_single(context, sparsity, sequence(context).frames[sparsity, True])


def _left_by_forgotten(context: StudyContext, sparsity: int) -> Measured:
    """Return the same where history is thrown away before each frame."""
    return _change_over_single(context, sparsity, sequence(context).forgotten[sparsity])


def _change_over_single(context: StudyContext, sparsity: int, frames: np.ndarray) -> Measured:
    found = sequence(context)
    single, kept = (
        math.sqrt(float(np.mean(changes(each, found.motion) ** 2)))
        for each in (found.frames[sparsity, False], frames)
    )
    return Measured(value=kept / single)
