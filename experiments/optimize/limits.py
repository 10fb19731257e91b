"""What must not get worse while an error falls: leaking, over-occlusion and cost.

Each limit pushes from the start on, by a penalty that is a square and reaches 1, the objective's
value at the start, where what it allows ends. Past that end a point is refused. So a fit slides
along a limit, and no result ever lies beyond one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from experiments.optimize.intervals import LEVEL
from experiments.optimize.statistics import FrameValues

LEAST_ALLOWANCE = {"dark_excess": 1e-4, "missing_energy": 1e-3}
"""Least that is allowed on top of the start, shares of the scene's light: below it, a change cannot
be seen."""

LEAST_SHARE = 0.02
"""Least that is allowed as a share of the start."""

COST_SHARE = 0.02
"""How much more work than the start equal cost may be, as a share."""


ROUNDING = 1e-9
"""Relative rounding of a mean."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A bound on the mean of a number over a scene's frames.

    Attributes
    ----------
    name
        Attribute of `FrameValues`.
    scene
        Number of the scene.
    start
        The mean where the fit started.
    allowance
        How much more is allowed.
    """

    name: str
    scene: int
    start: float
    allowance: float

    def mean(self, frames: Sequence[FrameValues]) -> float:
        """Return the number's mean over frames."""
        return float(np.mean([getattr(each, self.name) for each in frames]))

    def is_broken(self, value: float) -> bool:
        """Whether a mean is refused."""
        return value > self.start + self.allowance

    def push(self, value: float) -> float:
        """Return the residual whose square is the penalty.

        It is 0 up to the start, and 1 at the end of the allowance.
        """
        return max(0.0, (value - self.start) / self.allowance)

    def is_active(self, value: float) -> bool:
        """Whether a step may meet the limit: its curvature counts from the start itself on."""
        return value >= self.start * (1.0 - ROUNDING)

    @property
    def push_slope(self) -> float:
        """Derivative of `push` where it is above 0."""
        return 1.0 / self.allowance


def leak_limits(scene: int, frames: Sequence[FrameValues]) -> list[Limit]:
    """Return limits on leaking and over-occlusion: the start and its interval over frames."""
    limits = []
    for name, least in LEAST_ALLOWANCE.items():
        values = [getattr(each, name) for each in frames]
        start = float(np.mean(values))
        allowance = max(half_width(values), least, LEAST_SHARE * start)
        limits.append(Limit(name=name, scene=scene, start=start, allowance=allowance))
    return limits


def cost_limits(scene: int, frames: Sequence[FrameValues]) -> list[Limit]:
    """Return the limit on what cones take: samples and rays together, by their times."""
    start = float(np.mean([each.work for each in frames]))
    allowance = max(COST_SHARE * start, 1e-9)
    return [Limit(name="work", scene=scene, start=start, allowance=allowance)]


def half_width(values: Sequence[float]) -> float:
    """Return half of the interval of a mean of independent values; 0 for a single one."""
    count = len(values)
    if count < 2:
        return 0.0
    error = float(np.std(values, ddof=1)) / math.sqrt(count)
    return float(stdtrit(count - 1, 0.5 + 0.5 * LEVEL)) * error
