"""Confidence intervals from independent reference batches, by the delete-one jackknife.

The noise of a path-traced reference is the only randomness here: the test image is fixed. Pixels
share samples and filters, so only whole batches, each with a seed of its own, are independent;
resampling pixels would give an interval that is too narrow.

References
----------
Quenouille (1956), "Notes on bias in estimation"; Tukey (1958) for pseudo-values and their t
interval; Miller (1974), "The jackknife - a review".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from metrics.images import Batches, Image, checked_batches

Encoded = TypeVar("Encoded")
"""An image in the space where a distance is measured."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number, and the interval that holds its true value with probability `level`."""

    value: float
    low: float
    high: float
    level: float


def jackknife(
    statistic: Callable[[Batches], float], batches: ArrayLike, level: float = 0.95
) -> Estimate:
    """Estimate a statistic of the reference with a confidence interval.

    Parameters
    ----------
    statistic
        Number from batches ``(m, H, W, 3)``, for any ``m >= M - 1``; symmetric in the batches.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 2.
    level
        Probability that the interval holds the true value, in (0, 1).

    Returns
    -------
    Estimate
        See `estimate_from_leave_one_out`.

    Raises
    ------
    ValueError
        For fewer than 2 batches, an illegal shape or value, or a level outside (0, 1).
    """
    checked = checked_batches(batches, least=2)
    without_one = [
        statistic(np.delete(checked, left_out, axis=0)) for left_out in range(len(checked))
    ]
    return estimate_from_leave_one_out(statistic(checked), np.array(without_one), level)


def jackknife_of_mean(
    statistic: Callable[[Image], float], batches: Batches, level: float = 0.95
) -> Estimate:
    """Jackknife of a statistic that reads only the mean of the batches.

    Gives what `jackknife` gives, from one sum over the batches in place of M + 1.

    Parameters
    ----------
    statistic
        Number from a reference image ``(H, W, 3)``.
    batches
        Checked float64 batches, ``(M, H, W, 3)``, M >= 2.
    level
        Probability that the interval holds the true value, in (0, 1).
    """
    count = len(batches)
    total = batches.sum(axis=0)
    without_one = [statistic((total - batch) / (count - 1)) for batch in batches]
    return estimate_from_leave_one_out(statistic(total / count), np.array(without_one), level)


def jackknife_of_distance(
    distance: Callable[[Encoded, Encoded], float],
    encode: Callable[[Image], Encoded],
    test: Image,
    batches: Batches,
    level: float = 0.95,
) -> Estimate:
    """Jackknife of a distance from the test to the mean of the batches, with its noise floor.

    A distance takes the noise of the reference for error, and no correction removes that exactly:
    ``|V - R|`` has a kink where they meet, and rare bright samples keep their share of it however
    many batches there are. But by the triangle inequality the true distance is at least the
    measured one less the reference's own distance from the truth; and the distance between two
    halves of the batches, whose difference is twice as noisy as the mean, bounds that one. The
    lower end allows for it. The upper end needs no allowance, because noise only adds.

    Parameters
    ----------
    distance
        ``distance(V, R)`` of encoded images, >= 0, 0 for equal ones.
    encode
        From linear RGB ``(H, W, 3)`` to what `distance` reads.
    test
        Checked float64 image, ``(H, W, 3)``.
    batches
        Checked float64 batches, ``(M, H, W, 3)``, M >= 2.
    level
        Probability that the interval holds the true value, in (0, 1).
    """
    count = len(batches)
    total = batches.sum(axis=0)
    encoded_test = encode(test)
    first_half, second_half = (
        encode(half.mean(axis=0)) for half in (batches[: count // 2], batches[count // 2 :])
    )
    return estimate_from_leave_one_out(
        distance(encoded_test, encode(total / count)),
        np.array([distance(encoded_test, encode((total - one) / (count - 1))) for one in batches]),
        level,
        noise_floor=distance(first_half, second_half),
    )


def estimate_from_leave_one_out(
    full: float,
    without_one: NDArray[np.float64],
    level: float = 0.95,
    *,
    noise_floor: float = 0.0,
) -> Estimate:
    """Bias-corrected jackknife estimate with an interval of Student's t, M - 1 degrees of freedom.

    The value is the mean of the pseudo-values ``M full - (M - 1) without_one[k]``: the bias that
    falls as 1/M is gone, and a U-statistic, which has none, is left as it is. Where the bias falls
    in another way the correction may be too large or too small, so the interval spans the
    corrected and the uncorrected value, and the t interval's half width goes beyond both.

    Parameters
    ----------
    full
        Statistic of all M batches.
    without_one
        Statistic without batch k, ``(M,)``, M >= 2.
    level
        Probability that the interval holds the true value, in (0, 1).
    noise_floor
        How far noise alone may have raised `full`, >= 0; the lower end allows for it.

    Returns
    -------
    Estimate
        Value and interval. They may leave the range of the statistic (an MSE below zero, an SSIM
        above one): that says "below the noise of the reference" and is never clamped, because a
        clamped estimate is biased.

    Raises
    ------
    ValueError
        For fewer than 2 entries or a level outside (0, 1).
    """
    count = len(without_one)
    if count < 2:
        raise ValueError(
            f"without_one must hold at least 2 entries, got {count}: one batch says nothing of "
            "its own noise, render the reference in more."
        )
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must be in (0, 1), got {level}: use 0.95 for 95 %.")
    pseudo_values = count * full - (count - 1) * without_one
    value = float(pseudo_values.mean())
    standard_error = float(pseudo_values.std(ddof=1)) / sqrt(count)
    half_width = float(stdtrit(count - 1, 0.5 + 0.5 * level)) * standard_error
    return Estimate(
        value=value,
        low=min(value, full - noise_floor) - half_width,
        high=max(value, full) + half_width,
        level=level,
    )
