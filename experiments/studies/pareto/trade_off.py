"""What points of error against time say: front, slope, floor, crossings. Synthetic data will do.

Errors of unbiased methods fall as one over time; those of biased ones towards a floor. Intervals
are of 95 %: of fits by Student's t with the spread of the residuals, of crossings by drawing the
errors anew, each from its own interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from experiments.studies.check import INTERVAL_LEVEL, Measured

DRAWS: Final = 1000
"""Of all errors at once, for the interval of a crossing."""

HALF_WIDTHS: Final = 1.959964
"""Standard errors in half a 95 % interval of a normal distribution."""

MOST_RELATIVE_ERROR: Final = 0.5
"""Standard error over value beyond which the noise hides an error, so that it has no logarithm."""

LEAST_FOR_SLOPE, LEAST_FOR_FLOOR = 3, 3
"""Points that a fit of two numbers and their spread needs."""

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Errors along one axis, such as time or samples a pixel.

    Attributes
    ----------
    x
        Places on the axis, > 0, ascending.
    values
        Errors there.
    standard_errors
        Of the errors, >= 0.
    x_spreads
        Standard errors of the places over the places; None: they are exact.
    """

    x: Float64
    values: Float64
    standard_errors: Float64
    x_spreads: Float64 | None = None

    @classmethod
    def of(cls, x: Sequence[Measured], errors: Sequence[Measured]) -> Errors:
        """Return places and errors with their intervals, in the order of the places."""
        places = np.array([each.value for each in x])
        order = np.argsort(places, kind="stable")
        return cls(
            places[order],
            np.array([each.value for each in errors])[order],
            np.array([standard_error(each) for each in errors])[order],
            (np.array([standard_error(each) for each in x]) / places)[order],
        )

    def seen(self) -> Errors:
        """Return those that the noise does not hide."""
        is_seen = (self.values > 0.0) & (
            self.standard_errors <= MOST_RELATIVE_ERROR * np.abs(self.values)
        )
        spreads = np.zeros_like(self.x) if self.x_spreads is None else self.x_spreads
        return Errors(
            self.x[is_seen], self.values[is_seen], self.standard_errors[is_seen], spreads[is_seen]
        )


@dataclass(frozen=True)
class Floor:
    """What is left of an error with any number of samples.

    Attributes
    ----------
    level
        b^2 of a / n + b^2; below zero where noise hides it.
    slope
        a.
    """

    level: Measured
    slope: float


@dataclass(frozen=True)
class Crossing:
    """Where a curve of errors comes down to a given one.

    Attributes
    ----------
    time
        On the curve's axis; a bound, without an interval, where the curve does not cross.
    reached
        "inside" the curve, "before" its first point, or "never".
    """

    time: Measured
    reached: Literal["inside", "before", "never"]


def standard_error(found: Measured) -> float:
    """Return the standard error behind a 95 % interval, 0 where there is none."""
    if found.low is None or found.high is None:
        return 0.0
    return (found.high - found.low) / (2.0 * HALF_WIDTHS)


def pareto_front(times: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Return the points that no other beats in time and error, from fast to exact.

    Of equal points the first counts.
    """
    order = sorted(range(len(times)), key=lambda each: (times[each], errors[each], each))
    front: list[int] = []
    for each in order:
        if not front or errors[each] < errors[front[-1]]:
            front.append(each)
    return front


def fit_slope(errors: Errors) -> Measured:
    """Return the slope of log error over log x, by weighted least squares.

    Points that noise hides are left out; weights are one over the variance of the logarithm, which
    is at least a thousandth squared, so that no point decides alone.

    Raises
    ------
    ValueError
        Fewer than `LEAST_FOR_SLOPE` points are left.
    """
    seen = errors.seen()
    _require(len(seen.x), LEAST_FOR_SLOPE, "a slope")
    relative = np.maximum(seen.standard_errors / seen.values, 1e-3)
    design = np.stack([np.log(seen.x), np.ones_like(seen.x)], axis=1)
    return _weighted_fit(design, np.log(seen.values), relative)[0]


def fit_floor(errors: Errors) -> Floor:
    """Fit error = a / x + b^2 by weighted least squares; b^2 is not kept from going below zero.

    Raises
    ------
    ValueError
        There are fewer than `LEAST_FOR_FLOOR` points.
    """
    _require(len(errors.x), LEAST_FOR_FLOOR, "a floor")
    least = 1e-3 * float(np.abs(errors.values).max()) or 1.0
    design = np.stack([1.0 / errors.x, np.ones_like(errors.x)], axis=1)
    slope, level = _weighted_fit(design, errors.values, np.maximum(errors.standard_errors, least))
    return Floor(level=level, slope=slope.value)


def time_to_reach(errors: Errors, target: Measured, seed: int = 0) -> Crossing:
    """Return where a curve, straight between its points in both logarithms, comes down to an error.

    Parameters
    ----------
    errors
        The curve; points that noise hides are left out.
    target
        The error, > 0.
    seed
        Of the draws.

    Raises
    ------
    ValueError
        The target is not above zero, or the noise hides all points.
    """
    seen = errors.seen()
    _require(len(seen.x), 1, "a crossing")
    if not target.value > 0.0:
        raise ValueError(f"the error to reach must be above 0, got {target.value}: noise hides it.")
    log_x, log_errors = np.log(seen.x), np.log(seen.values)
    best = _first_crossing(log_x, log_errors, math.log(target.value))
    if best == -math.inf:
        return Crossing(Measured(value=float(seen.x[0])), "before")
    if best == math.inf:
        return Crossing(Measured(value=float(seen.x[-1])), "never")
    random = np.random.default_rng(seed)
    spreads = seen.standard_errors / seen.values
    own = standard_error(target) / target.value
    assert seen.x_spreads is not None, "seen() gives them"
    found = [
        _first_crossing(
            log_x + seen.x_spreads * random.standard_normal(len(log_x)),
            log_errors + spreads * random.standard_normal(len(log_x)),
            math.log(target.value) + own * random.standard_normal(),
        )
        for _ in range(DRAWS)
    ]
    # What a draw does not reach lies beyond the end, wherever that is.
    ends = np.exp(np.clip(found, log_x[0], log_x[-1]))
    low, high = np.quantile(ends, [0.5 - 0.5 * INTERVAL_LEVEL, 0.5 + 0.5 * INTERVAL_LEVEL])
    value = math.exp(best)
    return Crossing(
        Measured(value=value, low=min(float(low), value), high=max(float(high), value)), "inside"
    )


def error_at(errors: Errors, x: float) -> Measured | None:
    """Return the error of a curve at a place, straight in both logarithms; None beyond its ends."""
    seen = errors.seen()
    if len(seen.x) < 2 or not seen.x[0] <= x <= seen.x[-1]:
        return None
    right = min(max(int(np.searchsorted(seen.x, x)), 1), len(seen.x) - 1)
    left = right - 1
    step = math.log(seen.x[right] / seen.x[left])
    share = math.log(x / seen.x[left]) / step if step > 0.0 else 0.0
    log_value = (1.0 - share) * math.log(seen.values[left]) + share * math.log(seen.values[right])
    relative = seen.standard_errors / seen.values
    spread = math.hypot((1.0 - share) * relative[left], share * relative[right])
    value = math.exp(log_value)
    return Measured(
        value=value,
        low=value * math.exp(-HALF_WIDTHS * spread),
        high=value * math.exp(HALF_WIDTHS * spread),
    )


def ratio(above: Measured, below: Measured) -> Measured:
    """Return a quotient of two independent positive numbers, its interval by logarithms."""
    value = above.value / below.value
    if above.low is None and below.low is None:
        return Measured(value=value)
    spread = math.hypot(
        standard_error(above) / above.value,
        standard_error(below) / below.value,
    )
    return Measured(
        value=value,
        low=value * math.exp(-HALF_WIDTHS * spread),
        high=value * math.exp(HALF_WIDTHS * spread),
    )


def _first_crossing(log_x: Float64, log_errors: Float64, log_target: float) -> float:
    """Return the logarithm of the first place, -inf before all points, inf beyond them."""
    reached = np.flatnonzero(log_errors <= log_target)
    if len(reached) == 0:
        return math.inf
    right = int(reached[0])
    if right == 0:
        return -math.inf
    left = right - 1
    fall = log_errors[left] - log_errors[right]
    share = (log_errors[left] - log_target) / fall
    return float(log_x[left] + share * (log_x[right] - log_x[left]))


def _weighted_fit(design: Float64, values: Float64, spreads: Float64) -> list[Measured]:
    """Return the parameters of a linear model with Student's t intervals.

    The spread of the residuals scales the covariance where it is larger than the errors say.
    """
    weighted = design / spreads[:, None]
    scaled = values / spreads
    inverse = np.linalg.inv(weighted.T @ weighted)
    found = inverse @ weighted.T @ scaled
    freedom = len(values) - design.shape[1]
    residual = float(np.sum((scaled - weighted @ found) ** 2)) / freedom
    reach = float(stdtrit(freedom, 0.5 + 0.5 * INTERVAL_LEVEL)) * math.sqrt(max(residual, 1.0))
    halves = reach * np.sqrt(np.diag(inverse))
    return [
        Measured(value=float(value), low=float(value - half), high=float(value + half))
        for value, half in zip(found, halves, strict=True)
    ]


def _require(count: int, least: int, what: str) -> None:
    if count < least:
        raise ValueError(f"{what} needs at least {least} points that noise does not hide: {count}.")
