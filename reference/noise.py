"""How noisy a reference is, and whether that is little enough for what is asked of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from scipy.special import stdtrit

from reference.request import Reference

LEAST_FACTOR: Final = 10.0
"""How far the noise floor must lie below the smallest difference that is asked about."""
LEAST_BATCHES: Final = 4
"""Batches that it takes to say how noisy their mean is, with an interval."""
EPSILON_SHARE: Final = 0.01
"""Of the squared mean luminance: keeps the relative error finite in the dark, at any exposure."""
LEVEL: Final = 0.95
"""Chance that the noise lies below the upper end of its interval."""
_LUMINANCE: Final = np.array([0.212671, 0.715160, 0.072169])
"""Luminance of linear Rec. 709 primaries, Mitsuba's `mi.luminance`."""


class NoisyReferenceError(ValueError):
    """A reference is too noisy for what is asked of it; the message is one line with a remedy."""


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """Relative squared error of a reference's mean.

    Attributes
    ----------
    value
        Mean over pixels and channels of s^2 / M / (R^2 + eps): R mean and s^2 variance of M
        batches, eps `EPSILON_SHARE` of the squared mean luminance; a pure number, NaN where there
        is no light.
    upper
        One-sided bound at `LEVEL`, by the delete-one jackknife and Student's t.
    samples_per_pixel
        Paths a pixel that it took.
    """

    value: float
    upper: float
    samples_per_pixel: int

    def samples_for(self, target: float) -> int:
        """Paths a pixel whose noise would be `target`: it falls as one over their number."""
        return int(np.ceil(self.samples_per_pixel * self.upper / target))


def noise_floor(reference: Reference, component: str = "image") -> NoiseFloor:
    """Estimate the noise of the mean of a reference's batches.

    Parameters
    ----------
    reference
        At least `LEAST_BATCHES` batches.
    component
        Which light, as in `Reference.batches`.

    Raises
    ------
    NoisyReferenceError
        There are fewer batches.
    ValueError
        There is no such component.
    """
    return noise_of(reference.batches(component), reference.request.samples_per_pixel)


def noise_of(batches: np.ndarray, samples_per_pixel: int) -> NoiseFloor:
    """`noise_floor` of bare batches `[batch, y, x, rgb]`."""
    count = len(batches)
    if count < LEAST_BATCHES:
        raise NoisyReferenceError(
            f"{count} batches do not say how noisy their mean is: render at least {LEAST_BATCHES}."
        )
    total = np.zeros(batches.shape[1:])
    squares = np.zeros(batches.shape[1:])
    for batch in batches:
        total += batch
        squares += np.square(batch, dtype=np.float64)
    value = _relative_noise(total, squares, count)
    # How noisy the same number of batches would be, as told by all but one of them
    without_one = np.array(
        [
            _relative_noise(total - batch, squares - np.square(batch, dtype=np.float64), count - 1)
            * ((count - 1) / count)
            for batch in batches
        ]
    )
    error = sqrt((count - 1) / count * float(np.sum((without_one - without_one.mean()) ** 2)))
    upper = value + float(stdtrit(count - 1, LEVEL)) * error
    return NoiseFloor(value=value, upper=upper, samples_per_pixel=samples_per_pixel)


def require_low_noise(
    reference: Reference, smallest_difference: float, components: Sequence[str] = ("image",)
) -> None:
    """Refuse to compare with a reference that cannot show the difference asked about.

    Parameters
    ----------
    reference
        What would be compared with.
    smallest_difference
        Smallest relative squared error that the comparison is to tell from none, > 0.
    components
        Which light is compared.

    Raises
    ------
    NoisyReferenceError
        The upper bound of the noise of a component is not `LEAST_FACTOR` times smaller; or the
        batches are too few, or hold no light, so that nobody can say.
    ValueError
        `smallest_difference` is not above 0.
    """
    for component in components:
        require_low_noise_of(
            reference.batches(component),
            reference.request.samples_per_pixel,
            smallest_difference,
            f"{component!r} of reference {reference.key[:12]}",
        )


def require_low_noise_of(
    batches: np.ndarray, samples_per_pixel: int, smallest_difference: float, name: str
) -> None:
    """`require_low_noise` of bare batches `[batch, y, x, rgb]` that a message calls `name`."""
    target = target_from_difference(smallest_difference)
    floor = noise_of(batches, samples_per_pixel)
    if not np.isfinite(floor.value):
        raise NoisyReferenceError(
            f"{name} has no light: a relative difference has no value there, compare absolute ones "
            "or light the scene."
        )
    if floor.upper > target:
        raise NoisyReferenceError(
            f"{name} is too noisy to compare: its noise relMSE of {floor.value:.2g} (below "
            f"{floor.upper:.2g} at {LEVEL:.0%}) is not {LEAST_FACTOR:g} times below "
            f"{smallest_difference:.2g}, the smallest difference asked about; render to a relMSE "
            f"of {target:.2g}, about {floor.samples_for(target)} paths a pixel in place of "
            f"{floor.samples_per_pixel}."
        )


def target_from_difference(smallest_difference: float) -> float:
    """Noise relMSE at which a reference can show a relative squared error of this size.

    Raises
    ------
    ValueError
        It is not above 0.
    """
    if not smallest_difference > 0.0:
        raise ValueError(f"smallest_difference must be above 0, got {smallest_difference}.")
    return smallest_difference / LEAST_FACTOR


def _relative_noise(total: np.ndarray, squares: np.ndarray, count: int) -> float:
    """Mean relative variance of the mean of batches, from their sum and sum of squares."""
    mean = total / count
    # Rounding may take the spread of equal batches below zero by a last bit
    variance = np.maximum(squares - total * mean, 0.0) / (count - 1)
    epsilon = EPSILON_SHARE * float((mean @ _LUMINANCE).mean()) ** 2
    if not epsilon > 0.0:
        return float("nan")
    return float(np.mean(variance / count / (mean**2 + epsilon)))
