"""Exponents of growth: slopes of logarithms, over all sizes and between the two largest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from experiments.studies.check import INTERVAL_LEVEL, Measured


@dataclass(frozen=True)
class Cost:
    """What a size costs; the ends are those of the repetitions."""

    size: float
    value: float
    low: float
    high: float


def fitted_exponent(costs: Sequence[Cost]) -> Measured:
    """Return the slope of log cost over log size with Student's t interval, None for two sizes.

    Raises
    ------
    ValueError
        Fewer than two sizes, or a cost that has no logarithm.
    """
    _require(costs)
    x = np.log([each.size for each in costs])
    y = np.log([each.value for each in costs])
    centred = x - x.mean()
    slope = float(centred @ y / (centred @ centred))
    freedom = len(costs) - 2
    if freedom == 0:
        return Measured(value=slope)
    residual = y - y.mean() - slope * centred
    error = math.sqrt(float(residual @ residual) / freedom / float(centred @ centred))
    half = float(stdtrit(freedom, 0.5 * (1.0 + INTERVAL_LEVEL))) * error
    return Measured(value=slope, low=slope - half, high=slope + half)


def last_exponent(costs: Sequence[Cost]) -> Measured:
    """Return the slope between the two largest sizes, with the range that the repetitions allow.

    A fixed cost makes the slope over all sizes small; here it is least in the way.
    """
    _require(costs)
    before, after = sorted(costs, key=lambda each: each.size)[-2:]
    factor = math.log(after.size / before.size)
    return Measured(
        value=math.log(after.value / before.value) / factor,
        low=math.log(after.low / before.high) / factor,
        high=math.log(after.high / before.low) / factor,
    )


def _require(costs: Sequence[Cost]) -> None:
    if len(costs) < 2:
        raise ValueError("growth: an exponent needs two sizes at least.")
    if min(each.low for each in costs) <= 0.0:
        raise ValueError("growth: a cost of 0 has no exponent.")
