"""Study "flicker": whether the light of surfaces holds still while the eye moves.

See `metrics/flicker.py` for the measures: change along exact motion vectors beyond the truth's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from experiments.scenes import scene_file_name
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.figures import Curve, Point
from experiments.studies.flicker.definitions import DEFINITIONS as DEFINITIONS
from experiments.studies.flicker.maps import add_flicker_maps
from experiments.studies.flicker.sequences import SPARSITIES, Sequence, sequence
from metrics.energy import energy_ratio
from metrics.flicker import changes, flicker, flicker_rms
from metrics.measurement import Measurement

Measure = Callable[[Sequence, tuple[int, bool]], Measurement]


def _energy(found: Sequence, which: tuple[int, bool]) -> Measurement:
    rows = (-1, found.batches.shape[3], 3)
    batches = found.batches.reshape(len(found.batches), *rows)
    return energy_ratio(found.frames[which].reshape(rows), batches)


RMS = "RMS change beyond the truth's"

MEASURES: dict[str, Measure] = {
    "mean change beyond the truth's": lambda found, which: flicker(
        found.frames[which], found.batches, found.motion
    ),
    RMS: lambda found, which: flicker_rms(found.frames[which], found.batches, found.motion),
    "energy": _energy,
}
"""What is measured of each sequence."""

OVER_SPARSITY = Curve(
    group="Change from frame to frame",
    title="Flicker by the number of camera rays for each that traces cones",
    caption="RMS change beyond the truth's along exact motion vectors, over the mean light.",
    x_label="camera rays for each that traces cones",
    y_label="RMS flicker",
    is_x_log=True,
)

SCENE = "built-in cornell_box, or --scene; diffuse light, 4 rays a pixel, 0.44 pixels a frame"


WAYS = {False: "single frames", True: "accumulated"}


def checks() -> list[Check]:
    """Return the checks of flicker."""
    found = []
    for sparsity in SPARSITIES:
        name = "dense" if sparsity == 1 else f"every {sparsity}th ray"
        base = f'preset "high" with N = 64, sparsity {sparsity}'
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
    return found


def _measure(context: StudyContext, name: str, which: tuple[int, bool]) -> Measured:
    slide = sequence(context)
    _draw(context, slide)
    found = MEASURES[name](slide, which)
    return Measured(value=found.value, low=found.low, high=found.high)


def _draw(context: StudyContext, found: Sequence) -> None:
    group = "Cornell box" if context.scene is None else scene_file_name(Path(context.scene))
    draw = partial(
        add_flicker_maps, context.shelf, group, found.frames, found.batches, found.motion
    )
    context.once("flicker maps", draw)


def _left(context: StudyContext, sparsity: int) -> Measured:
    """Own change of accumulated over single frames: without the truth, whose noise both share."""
    found = sequence(context)
    single, kept = (
        math.sqrt(float(np.mean(changes(found.frames[sparsity, each], found.motion) ** 2)))
        for each in (False, True)
    )
    return Measured(value=kept / single)
