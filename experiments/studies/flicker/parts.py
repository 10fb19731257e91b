"""Rows that say where flicker comes from: noise, structure, traced pixels, edges."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.figures import Point
from experiments.studies.flicker.names import OVER_SPARSITY, SCENE, configuration, name_of
from experiments.studies.flicker.sequences import (
    LIMITED,
    RENDERINGS,
    SPARSITIES,
    Sequence,
    sequence,
    truth_of,
)
from metrics.flicker import changes, flicker_rms
from metrics.flicker_parts import flicker_noise, flicker_structure
from metrics.measurement import Measurement

STRUCTURE, NOISE = "structure, RMS", "noise, RMS"

BEYOND_DENSE = "RMS change beyond dense pixels'"

SEEDS = f"{RENDERINGS[0]} seeds, {RENDERINGS[1]} in the quick version"

PARTS = {NOISE: flicker_noise, STRUCTURE: flicker_structure}

UNLIMITED = f"{name_of(LIMITED)} without a limit on contrast"


def part_checks() -> list[Check]:
    """Return the checks of what flicker is made of."""
    return [*_parts(), *_of_traced_pixels(), *_of_edges()]


def _parts() -> list[Check]:
    found = [
        Check(
            name=f"{name_of(sparsity)}, {part}",
            configuration=f"{configuration(sparsity)}, {SEEDS}",
            scene=SCENE,
            measure=partial(_part, sparsity=sparsity, part=part),
            goal=0.0,
            points=(Point(OVER_SPARSITY, part.removesuffix(", RMS"), sparsity),),
        )
        for sparsity in SPARSITIES
        for part in PARTS
    ]
    return [
        *found,
        Check(
            name=f"noise of dense frames over that of {name_of(LIMITED)}",
            configuration=f'preset "high" with N = 64, {SEEDS}',
            scene=SCENE,
            measure=_noise_of_dense,
            limit_low=1.0,
        ),
    ]


def _of_traced_pixels() -> list[Check]:
    """Rows of cones that are never turned: no noise, and dense pixels in the truth's place."""
    ways = [(each, True) for each in SPARSITIES if each > 1] + [(LIMITED, False)]
    found = [
        Check(
            name=f"fixed cones, {name_of(sparsity) if has_limit else UNLIMITED}, {BEYOND_DENSE}",
            configuration=f"{configuration(sparsity)}, no rotation, no jitter",
            scene=SCENE,
            measure=partial(_fixed_beyond_dense, sparsity=sparsity, has_limit=has_limit),
            goal=0.0,
        )
        for sparsity, has_limit in ways
    ]
    fewest, most = SPARSITIES[1], SPARSITIES[-1]
    return [
        *found,
        Check(
            name=f"fixed cones, {name_of(most)} over {name_of(fewest)}, {BEYOND_DENSE}",
            configuration='preset "high" with N = 64, no rotation, no jitter',
            scene=SCENE,
            measure=partial(_fixed_ratio, fewest=fewest, most=most),
            limit_low=1.0,
        ),
    ]


def _of_edges() -> list[Check]:
    """Rows of frames with the limit on contrast and without, edges left out and let in."""
    frames: dict[str, Callable[[Sequence], np.ndarray]] = {
        name_of(1): partial(_single, sparsity=1),
        name_of(LIMITED): partial(_single, sparsity=LIMITED),
        UNLIMITED: _unlimited,
    }
    found = []
    for name, take in frames.items():
        for lets_edges_in in (True, False):
            if not lets_edges_in and name != UNLIMITED:
                # A row of its own already.
                continue
            found.append(
                Check(
                    name=f"edges let in, {name}, RMS change beyond the truth's"
                    if lets_edges_in
                    else f"{name}, RMS change beyond the truth's",
                    configuration=configuration(1 if name == name_of(1) else LIMITED)
                    + (", surfaces told apart by their planes alone" if lets_edges_in else ""),
                    scene=SCENE,
                    measure=partial(_rms, take=take, lets_edges_in=lets_edges_in),
                    goal=0.0,
                )
            )
    return found


def _part(context: StudyContext, sparsity: int, part: str) -> Measured:
    return _measured(_part_of(context, sparsity, part))


def _part_of(context: StudyContext, sparsity: int, part: str) -> Measurement:
    slide = sequence(context)
    return PARTS[part](slide.renderings[sparsity], truth_of(context), slide.motion)


def _noise_of_dense(context: StudyContext) -> Measured:
    dense, sparse = (_part_of(context, each, NOISE) for each in (1, LIMITED))
    return Measured(value=dense.value / sparse.value)


def _beyond_dense(context: StudyContext, sparsity: int, *, has_limit: bool = True) -> float:
    slide = sequence(context)
    found, dense = slide.fixed[sparsity, has_limit], slide.fixed[1, True]
    beyond = changes(found, slide.motion) - changes(dense, slide.motion)
    return math.sqrt(float(np.mean(beyond**2))) / float(dense.mean())


def _fixed_beyond_dense(context: StudyContext, sparsity: int, *, has_limit: bool) -> Measured:
    return Measured(value=_beyond_dense(context, sparsity, has_limit=has_limit))


def _fixed_ratio(context: StudyContext, fewest: int, most: int) -> Measured:
    return Measured(value=_beyond_dense(context, most) / _beyond_dense(context, fewest))


def _single(slide: Sequence, sparsity: int) -> np.ndarray:
    return slide.frames[sparsity, False]


def _unlimited(slide: Sequence) -> np.ndarray:
    return slide.unlimited


def _rms(
    context: StudyContext, take: Callable[[Sequence], np.ndarray], *, lets_edges_in: bool
) -> Measured:
    slide = sequence(context)
    motion = slide.motion_by_plane if lets_edges_in else slide.motion
    return _measured(flicker_rms(take(slide), truth_of(context), motion))


def _measured(found: Measurement) -> Measured:
    return Measured(value=found.value, low=found.low, high=found.high)
