"""The objective of a fit: errors of all training scenes over those at the start, and limits.

A scene's error counts in proportion to what it was at the start, so that the objective begins at 1
and a scene of small errors is worth as much as one of large ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from experiments.optimize.gauss_newton import LocalModel
from experiments.optimize.intervals import (
    Uncertainty,
    gradient_covariance,
    held_by_bounds,
    uncertainty,
)
from experiments.optimize.limits import Limit, cost_limits, leak_limits
from experiments.optimize.statistics import FrameSlopes, FrameValues
from experiments.optimize.target import Array


class Evaluator(Protocol):
    """What knows the frames of scenes at a point."""

    @property
    def scene_count(self) -> int:
        """Scenes."""

    @property
    def frame_count(self) -> int:
        """Frames of each scene."""

    def values(self, scene: int, frame: int, point: Array) -> FrameValues:
        """Return a frame's numbers."""

    def slopes(self, scene: int, frame: int, point: Array) -> FrameSlopes:
        """Return a frame's numbers and their derivatives."""


@dataclass(frozen=True, kw_only=True)
class LimitRules:
    """What is limited."""

    has_leaks: bool = True
    """Leaking and over-occlusion of each scene."""
    has_cost: bool = True
    """What cones read in each scene."""


LIMIT_RULES = LimitRules()

LEAST_ERROR = 1e-6
"""Least error at the start that a scene is divided by: a smaller one is lost in the noise."""


HOPELESS_COST = 1.2
"""Cost of a frame over what its mean is allowed to be, from which on no other frame is asked."""


class Fit:
    """An objective, made from the frames at the start.

    Parameters
    ----------
    evaluator
        Knows the frames.
    start
        Inner point, [parameter].
    rules
        What is limited.
    is_pushed
        Whether limits push before they refuse, for methods that follow derivatives; a search that
        only compares points needs no such slope, and would take noise within a limit for a loss.

    Attributes
    ----------
    start_errors
        Mean error of each scene at the start.
    limits
        What must not get worse.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        start: Array,
        rules: LimitRules = LIMIT_RULES,
        *,
        is_pushed: bool = True,
    ) -> None:
        self._evaluator = evaluator
        self._is_pushed = is_pushed
        frames = self.frames(start)
        self.start_errors = [max(_mean_error(each), LEAST_ERROR) for each in frames]
        self.limits: list[Limit] = []
        for scene, each in enumerate(frames):
            self.limits += leak_limits(scene, each) if rules.has_leaks else []
            self.limits += cost_limits(scene, each) if rules.has_cost else []

    @property
    def group_count(self) -> int:
        """Groups of frames for a stochastic optimiser: one frame of each scene."""
        return self._evaluator.frame_count

    def frames(self, point: Array) -> list[list[FrameValues]]:
        """Return all frames at a point, by scene."""
        evaluator = self._evaluator
        return [
            [evaluator.values(scene, frame, point) for frame in range(evaluator.frame_count)]
            for scene in range(evaluator.scene_count)
        ]

    def objective(self, frames: Sequence[Sequence[FrameValues]]) -> float:
        """Return the debiased objective: mean over scenes of error over that at the start."""
        shares = [
            _mean_error(each) / error for each, error in zip(frames, self.start_errors, strict=True)
        ]
        return float(np.mean(shares))

    def broken_limits(self, frames: Sequence[Sequence[FrameValues]]) -> list[Limit]:
        """Return the limits that frames break."""
        return [each for each in self.limits if each.is_broken(each.mean(frames[each.scene]))]

    def value(self, point: Array) -> float:
        """Return what is minimised, >= 0; infinity where a limit is broken."""
        if self.is_hopeless(point):
            return math.inf
        frames = self.frames(point)
        if self.broken_limits(frames):
            return math.inf
        squares = sum(
            self._share(scene) * each.squares
            for scene, scene_frames in enumerate(frames)
            for each in scene_frames
        )
        if not self._is_pushed:
            return float(squares)
        pushes = [each.push(each.mean(frames[each.scene])) for each in self.limits]
        return float(squares + sum(push**2 for push in pushes))

    def is_hopeless(self, point: Array) -> bool:
        """Whether a first frame alone costs more than any scatter of frames makes good.

        What cones read scatters little from frame to frame, so that a point that reads too much is
        known by one frame of one scene, and the others need not be rendered.
        """
        for limit in self.limits:
            if limit.name == "work":
                frame = self._evaluator.values(limit.scene, 0, point)
                if getattr(frame, limit.name) > HOPELESS_COST * (limit.start + limit.allowance):
                    return True
        return False

    def model(self, point: Array) -> LocalModel:
        """Return the same with derivatives."""
        slopes = self._slopes(point, range(self.group_count))
        count = len(point)
        value, gradient, curvature = 0.0, np.zeros(count), np.zeros((count, count))
        for scene, frames in enumerate(slopes):
            for each in frames:
                value += self._share(scene) * each.values.squares
                gradient += self._share(scene) * each.gradient
                curvature += self._share(scene) * each.normal
        for limit in self.limits:
            push, slope = _pushed(limit, slopes[limit.scene])
            value += push**2
            gradient += 2.0 * push * slope
            curvature += 2.0 * np.outer(slope, slope)
        return LocalModel(value=value, gradient=gradient, curvature=curvature)

    def group_gradient(self, point: Array, group: int) -> Array:
        """Return the gradient that one frame of each scene gives."""
        slopes = self._slopes(point, [group])
        gradient = np.zeros(len(point))
        for scene, frames in enumerate(slopes):
            gradient += self._share(scene) * self.group_count * frames[0].gradient
        for limit in self.limits:
            push, slope = _pushed(limit, slopes[limit.scene])
            gradient += 2.0 * push * slope
        return gradient

    def uncertainty(self, point: Array, low: Array, high: Array) -> Uncertainty:
        """Return intervals of the parameters, from the error alone, without the limits."""
        slopes = self._slopes(point, range(self.group_count))
        frames_share = [self._share(scene) * self.group_count for scene in range(len(slopes))]
        groups = [
            share * np.stack([each.gradient for each in frames])
            for share, frames in zip(frames_share, slopes, strict=True)
        ]
        covariance, degrees = gradient_covariance(groups)
        curvature = np.zeros_like(covariance)
        for share, frames in zip(frames_share, slopes, strict=True):
            curvature += share * np.mean([each.normal for each in frames], axis=0)
            # All frames of a scene are compared with one reference, so its noise does not average.
            covariance += share**2 * np.mean([each.reference_noise for each in frames], axis=0)
        gradient = sum(group.mean(axis=0) for group in groups)
        held = held_by_bounds(point, np.asarray(gradient), low, high)
        return uncertainty(curvature, covariance, degrees, high - low, held)

    def _share(self, scene: int) -> float:
        """Return how much one frame of a scene counts."""
        scenes, frames = self._evaluator.scene_count, self._evaluator.frame_count
        return 1.0 / (self.start_errors[scene] * scenes * frames)

    def _slopes(self, point: Array, frames: Sequence[int]) -> list[list[FrameSlopes]]:
        return [
            [self._evaluator.slopes(scene, frame, point) for frame in frames]
            for scene in range(self._evaluator.scene_count)
        ]


def _pushed(limit: Limit, frames: Sequence[FrameSlopes]) -> tuple[float, Array]:
    """Return a limit's residual and its derivatives, 0 where it is not active."""
    mean = limit.mean([each.values for each in frames])
    slope = np.mean([each.limited[limit.name] for each in frames], axis=0)
    return limit.push(mean), limit.push_slope * slope * limit.is_active(mean)


def _mean_error(frames: Sequence[FrameValues]) -> float:
    return float(np.mean([each.error for each in frames]))
