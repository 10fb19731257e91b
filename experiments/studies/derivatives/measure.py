"""One derivative in three ways: forward mode, reverse mode, and central differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Measured, mean_of
from experiments.studies.derivatives.room import way_of

Picture = Callable[[Any], "mi.Float"]

LEAST_SHARE = 0.02
"""Share of the mean picture below which a derivative counts as so much: 5 % of it are the 0.1 % of
the mean by which any derivative may be off."""


def moved(start: Any, share: float) -> Any:
    """Return values that are larger by a share of themselves, opaque."""
    numbers = np.array(start, dtype=np.float64)
    way = way_of(numbers.size).reshape(numbers.shape)
    found = type(start)(np.float32(numbers * (1.0 + share * way)))
    dr.make_opaque(found)
    return found


def moved_way(start: Any) -> Any:
    """Return the derivative of `moved` by the share."""
    numbers = np.array(start, dtype=np.float64)
    return type(start)(np.float32(numbers * way_of(numbers.size).reshape(numbers.shape)))


def mean_picture(picture: Picture, values: Any) -> float:
    """Return the mean of a picture, summed in double precision."""
    return float(np.mean(np.array(picture(values), dtype=np.float64)))


def by_differences(picture: Picture, start: Any, step: float) -> float:
    """Return the derivative of the mean picture by the share, from both sides."""
    upper, lower = (mean_picture(picture, moved(start, sign * step)) for sign in (1.0, -1.0))
    return (upper - lower) / (2.0 * step)


def by_reverse_mode(picture: Picture, start: Any, share: float = 0.0) -> float:
    """Return the derivative by the share, where it is `share`, by walking backward."""
    values = moved(start, share)
    dr.enable_grad(values)
    numbers = picture(values)
    dr.backward(numbers * (1.0 / dr.width(numbers)))
    slope = np.array(dr.grad(values), dtype=np.float64)
    held = np.array(start, dtype=np.float64)
    return float(np.sum(slope * held * way_of(held.size).reshape(held.shape)))


def by_forward_mode(picture: Picture, start: Any) -> float:
    """Return the derivative by the share, where it is 0, by walking forward."""
    values = moved(start, 0.0)
    dr.enable_grad(values)
    dr.set_grad(values, moved_way(start))
    return float(np.mean(forward_slope(picture(values))))


def forward_slope(numbers: Any) -> np.ndarray:
    """Return derivatives of numbers along the tangents that were set."""
    return np.array(dr.forward_to(numbers, flags=dr.ADFlag.ClearEdges), dtype=np.float64)


MODES: dict[str, Callable[[Picture, Any], float]] = {
    "forward": by_forward_mode,
    "reverse": by_reverse_mode,
}
"""Both modes by name."""


def disagreement(found: np.ndarray, wanted: np.ndarray, mean: np.ndarray) -> Measured:
    """Return how far a derivative is off, relative to it or to the least that counts.

    Parameters
    ----------
    found, wanted, mean
        Two derivatives and the mean of the picture, one each for every seed of the phases.
    """
    scale = max(abs(float(np.mean(wanted))), LEAST_SHARE * float(np.mean(mean)))
    signed = mean_of([float(each) for each in (found - wanted) / scale])
    value = abs(signed.value)
    if signed.low is None or signed.high is None:
        return Measured(value=value)
    half = 0.5 * (signed.high - signed.low)
    return Measured(value=value, low=max(0.0, value - half), high=value + half)
