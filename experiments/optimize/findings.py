"""What a view says of a fit: errors, limits, cost and time before and after."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.optimize.evaluation import FrameEvaluator
from experiments.optimize.frames import FrameSource
from experiments.optimize.limits import half_width
from experiments.optimize.statistics import FrameValues
from experiments.optimize.views import View
from metrics.confidence import Estimate, estimate_from_leave_one_out
from vctgi.config import RenderConfig

TIMED_FRAMES = 5
"""Frames of each configuration that are timed, in turn; their median counts."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A number with its interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class ViewFinding:
    """One view, each number before and after.

    Attributes
    ----------
    title
        The view.
    error
        `relmse_e2` of indirect diffuse light: mean over frames, with the scatter of the frames and
        the noise of the reference in the interval.
    ratio
        Error after over error before, of the same frames.
    dark_excess, missing_energy, samples, rays
        Means over frames.
    milliseconds
        Median time of gathering a frame, without voxels and light.
    """

    title: str
    error: tuple[Measured, Measured]
    ratio: Measured
    dark_excess: tuple[float, float]
    missing_energy: tuple[float, float]
    samples: tuple[float, float]
    rays: tuple[float, float]
    milliseconds: tuple[float, float]


def compare_view(
    view: View,
    evaluator: FrameEvaluator,
    scene: int,
    configs: tuple[RenderConfig, RenderConfig],
    source: FrameSource,
) -> ViewFinding:
    """Measure a view before and after.

    Parameters
    ----------
    view, evaluator, scene
        The view, who knows its frames, and its number there.
    configs
        Before and after.
    source
        Renders the timed frames.
    """
    numbers = range(evaluator.frame_count)
    estimates = [
        [evaluator.measured(scene, frame, config) for frame in numbers] for config in configs
    ]
    frames = [
        [evaluator.values_of(scene, frame, config) for frame in numbers] for config in configs
    ]
    before, after = ([each.value for each in some] for some in estimates)
    return ViewFinding(
        title=view.name.title,
        error=(_mean_error(estimates[0]), _mean_error(estimates[1])),
        ratio=ratio_of_means(after, before),
        dark_excess=_means("dark_excess", frames),
        missing_energy=_means("missing_energy", frames),
        samples=_means("samples", frames),
        rays=_means("rays", frames),
        milliseconds=gathering_times(view, configs, source),
    )


def ratio_of_means(after: Sequence[float], before: Sequence[float]) -> Measured:
    """Return mean over mean of paired numbers, with the jackknife over the pairs."""
    above, below = np.array(after), np.array(before)
    if len(above) < 2:
        return Measured(value=float(above[0] / below[0]), low=-math.inf, high=math.inf)
    without = (above.sum() - above) / (below.sum() - below)
    found = estimate_from_leave_one_out(float(above.sum() / below.sum()), without)
    return Measured(value=found.value, low=found.low, high=found.high)


def mean_ratio(findings: Sequence[ViewFinding]) -> Measured:
    """Return the mean over views of error after over error before; views are independent."""
    widths = [0.5 * (each.ratio.high - each.ratio.low) for each in findings]
    value = float(np.mean([each.ratio.value for each in findings]))
    half = math.sqrt(sum(width**2 for width in widths)) / len(findings)
    return Measured(value=value, low=value - half, high=value + half)


def _mean_error(estimates: Sequence[Estimate]) -> Measured:
    """Return the mean over frames; all of them are compared with one reference."""
    values = [each.value for each in estimates]
    value = float(np.mean(values))
    reference = float(np.mean([0.5 * (each.high - each.low) for each in estimates]))
    half = math.hypot(half_width(values), reference)
    return Measured(value=value, low=value - half, high=value + half)


def _means(name: str, frames: Sequence[Sequence[FrameValues]]) -> tuple[float, float]:
    before, after = (float(np.mean([getattr(each, name) for each in some])) for some in frames)
    return before, after


def gathering_times(
    view: View, configs: tuple[RenderConfig, RenderConfig], source: FrameSource
) -> tuple[float, float]:
    """Return how long each configuration gathers a frame, ms, taken in turn."""
    seconds: tuple[list[float], list[float]] = ([], [])
    for number in range(1 + TIMED_FRAMES):
        for place, config in enumerate(configs):
            began = time.perf_counter()
            source.gather(view, 0, config)
            # The first compiles.
            if number > 0:
                seconds[place].append(time.perf_counter() - began)
    before, after = (1e3 * statistics.median(each) for each in seconds)
    return before, after
