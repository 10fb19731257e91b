"""How sure a fit is of its parameters: (J^T J)^-1 with the noise that was measured.

Each frame has its own place in the lattice of the voxels and its own random numbers, so the scatter
of the frames' gradients is the noise of their mean; that of the reference's batches adds to it. The
covariance of the parameters is then H^-1 G H^-1, H being the curvature and G the covariance of the
gradient. Where residuals are independent and of variance s^2 this is the textbook's s^2 (J^T J)^-1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from experiments.optimize.target import Array

LEVEL = 0.95
"""Probability that an interval holds the true value."""

LARGEST_CONDITION = 1e8
"""Largest over smallest eigenvalue of a curvature that says something: with 1e8, parameters have to
be known to 1e-4 of one another's scale, which is what single-precision pictures allow."""


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """How sure a fit is.

    Attributes
    ----------
    half_widths
        [parameter] half of the interval, inner units; infinite where nothing is known, 0 where the
        parameter is at a bound that holds it.
    is_identified
        [parameter] whether the interval is narrower than the bounds.
    is_held
        [parameter] whether a bound holds the parameter.
    condition
        Largest over smallest eigenvalue of the curvature of the others.
    """

    half_widths: Array
    is_identified: NDArray[np.bool_]
    is_held: NDArray[np.bool_]
    condition: float


def gradient_covariance(groups: Sequence[Array]) -> tuple[Array, int]:
    """Return the covariance of a sum of means, and its degrees of freedom.

    Parameters
    ----------
    groups
        [frame, parameter] gradients of independent frames, one array for each scene, already
        weighted; the whole gradient is the sum over scenes of the mean over its frames.

    Raises
    ------
    ValueError
        A scene with one frame, whose scatter is unknown.
    """
    total = np.zeros((groups[0].shape[1],) * 2)
    degrees = 0
    for group in groups:
        count = len(group)
        if count < 2:
            raise ValueError(
                "gradient_covariance: one frame does not tell its own noise; take at least two."
            )
        centred = group - group.mean(axis=0)
        total += centred.T @ centred / (count * (count - 1))
        degrees += count - 1
    return total, degrees


def uncertainty(
    curvature: Array,
    covariance: Array,
    degrees: int,
    ranges: Array,
    is_held: NDArray[np.bool_],
    level: float = LEVEL,
) -> Uncertainty:
    """Return intervals and which parameters are not identified.

    Parameters
    ----------
    curvature
        Second derivatives of the objective at its minimum, [parameter, parameter].
    covariance
        Of its gradient, [parameter, parameter].
    degrees
        Degrees of freedom of that covariance.
    ranges
        [parameter] distance of the bounds, inner units.
    is_held
        [parameter] at a bound that the gradient presses it against: known as far as the bound is.
    level
        Probability that an interval holds the true value.
    """
    count = len(ranges)
    half_widths = np.zeros(count)
    free = np.flatnonzero(~is_held)
    condition = 1.0
    if len(free):
        # In units of the bounds, so that the condition does not depend on units.
        scale = ranges[free]
        scaled = curvature[np.ix_(free, free)] * np.outer(scale, scale)
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        largest = float(values[-1])
        known = values > max(largest, 0.0) / LARGEST_CONDITION
        condition = largest / float(values[0]) if values[0] > 0.0 else math.inf
        inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
        noise = covariance[np.ix_(free, free)] * np.outer(scale, scale)
        variances = np.diag(inverse @ noise @ inverse)
        reach = float(stdtrit(degrees, 0.5 + 0.5 * level)) * np.sqrt(np.maximum(variances, 0.0))
        # What a direction without curvature moves is not known at all.
        moved = np.abs(vectors[:, ~known]).max(axis=1, initial=0.0) > UNKNOWN_SHARE
        half_widths[free] = np.where(moved, np.inf, reach * scale)
    return Uncertainty(
        half_widths=half_widths,
        is_identified=2.0 * half_widths < ranges,
        is_held=is_held,
        condition=condition,
    )


UNKNOWN_SHARE = 0.1
"""Share of a direction without curvature above which a parameter takes part in it."""


def held_by_bounds(point: Array, gradient: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Return which parameters are at a bound that the gradient presses them against."""
    near = BOUND_SHARE * (high - low)
    at_low = (point - low < near) & (gradient > 0.0)
    at_high = (high - point < near) & (gradient < 0.0)
    return np.asarray(at_low | at_high)


BOUND_SHARE = 0.01
"""Share of the bounds' distance that counts as at the bound: a trust region only comes near."""
