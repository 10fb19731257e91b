"""The three scales on which a metric is compared: a number becomes an estimate with two bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from experiments.errors import InputError

Scale = Literal["error", "ratio", "similarity"]
"""`error`: 0 is perfect; `ratio`: 1 is perfect, compared by its logarithm; `similarity`: 1 is
perfect and less is worse, compared by 1 - value."""


@dataclass(frozen=True)
class Estimate:
    """A number and its interval on a scale's axis, where upwards is worse (or just more energy)."""

    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """The larger distance between the value and a bound, >= 0."""
        return max(self.high - self.value, self.value - self.low)

    def moved(self, distance: float) -> Estimate:
        """Return the same interval around a value moved by `distance` along the axis."""
        return Estimate(self.value + distance, self.low + distance, self.high + distance)


@dataclass(frozen=True)
class Band:
    """The values that a gate accepts, on a scale's axis; a side without a limit is infinite."""

    low: float
    high: float

    def sides(self) -> tuple[tuple[int, float], ...]:
        """Each finite limit with the direction (-1 or +1) in which it is crossed."""
        limits = ((-1, self.low), (1, self.high))
        return tuple((sign, limit) for sign, limit in limits if math.isfinite(limit))


def axis_from_metric(scale: Scale, value: float, where: str) -> float:
    """Put a metric's number on the axis of its scale.

    Raises
    ------
    InputError
        When a ratio is not above zero, so that it has no logarithm.
    """
    if scale == "ratio":
        if value <= 0.0:
            raise InputError(
                f"{value:.6g} is no ratio above zero",
                where,
                "raise the reference samples until the whole interval lies above zero, or gate "
                "this metric on the scale 'error'",
            )
        return math.log(value)
    return 1.0 - value if scale == "similarity" else value


def metric_from_axis(scale: Scale, position: float) -> float:
    """Invert `axis_from_metric`."""
    if scale == "ratio":
        return math.exp(position)
    return 1.0 - position if scale == "similarity" else position


def estimate_from_bounds(
    scale: Scale, value: float, low: float, high: float, where: str
) -> Estimate:
    """Put a metric's value and interval on the axis of its scale.

    Raises
    ------
    InputError
        When a bound of a ratio is not above zero.
    """
    bounds = (axis_from_metric(scale, low, where), axis_from_metric(scale, high, where))
    return Estimate(axis_from_metric(scale, value, where), min(bounds), max(bounds))


def estimate_from_noise(scale: Scale, value: float, noise: float, where: str) -> Estimate:
    """Give a metric without interval one of relative half-width `noise`.

    Relative to the value for an error, to 1 - value for a similarity; a ratio gets a factor
    of 1 + noise either way.
    """
    position = axis_from_metric(scale, value, where)
    half_width = math.log1p(noise) if scale == "ratio" else noise * abs(position)
    return Estimate(position, position - half_width, position + half_width)


def band_text(scale: Scale, band: Band) -> str:
    """Spell the band out in the metric's own unit."""
    limits = sorted(metric_from_axis(scale, limit) for _, limit in band.sides())
    if len(limits) == 2:
        return f"interval within [{limits[0]:.5g}, {limits[1]:.5g}]"
    if scale == "similarity":
        return f"lower bound >= {limits[0]:.5g}"
    return f"upper bound <= {limits[0]:.5g}"
