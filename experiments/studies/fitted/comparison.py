"""A shipped preset beside the one that it was fitted from, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

import vctgi
from experiments.optimize.findings import Measured as Ratio
from experiments.optimize.findings import gathering_times, ratio_of_means
from experiments.optimize.frames import FrameSource
from experiments.studies.check import StudyContext
from experiments.studies.fitted.budget import EFFORT, PRESET, study_view

FIRST_PLACE = 64
"""First place in the lattice: fits of up to so many frames saw none of these."""


@dataclass(frozen=True)
class Comparison:
    """A fitted preset over the one before.

    Attributes
    ----------
    error
        `relmse_e2` of indirect diffuse light, mean of frames over mean of frames.
    samples, rays
        What cones read, samples counted in those that interpolate; not a number where neither reads
        any.
    work
        Both together, by their times on an H200.
    milliseconds
        Median times of gathering.
    """

    error: Ratio
    samples: float
    rays: float
    work: float
    milliseconds: float


def comparison_of(context: StudyContext, scene: str, preset: str) -> Comparison:
    """Return a scene's numbers, measured once in a study."""
    return context.once(f"fitted, {preset} in {scene}", lambda: _comparison(context, scene, preset))


def _comparison(context: StudyContext, scene: str, preset: str) -> Comparison:
    view = study_view(context, scene)
    source = FrameSource(0, "differences")
    configs = (vctgi.preset(PRESET), vctgi.preset(preset))
    errors: tuple[list[float], list[float]] = ([], [])
    samples: tuple[list[float], list[float]] = ([], [])
    rays: tuple[list[float], list[float]] = ([], [])
    work: tuple[list[float], list[float]] = ([], [])
    places = EFFORT[context.quick].places
    for number in range(places):
        context.progress(f"{preset} in {view.name.title}", number / places)
        for which, config in enumerate(configs):
            picture = source.picture(view, FIRST_PLACE + number, config)
            errors[which].append(view.target.error(picture.image))
            samples[which].append(picture.cost.samples)
            rays[which].append(picture.cost.rays)
            work[which].append(picture.cost.work)
    before, after = gathering_times(view, configs, source)
    return Comparison(
        error=ratio_of_means(errors[1], errors[0]),
        samples=_ratio(samples),
        rays=_ratio(rays),
        work=_ratio(work),
        milliseconds=after / before,
    )


def _ratio(pair: tuple[Sequence[float], Sequence[float]]) -> float:
    """Return the second mean over the first; not a number where neither reads anything."""
    before, after = (fmean(each) for each in pair)
    if before == 0.0:
        return math.inf if after > 0.0 else math.nan
    return after / before
