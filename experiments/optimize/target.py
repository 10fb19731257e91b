"""What a picture should be: the reference of a view as a quadratic function of the picture.

The debiased relative squared error ``mean((V - R)^2 - s^2 / M) / (R^2 + eps)`` with weights from an
independent half of the batches is, both halves taken in turn, ``mean(w (V - C)^2) + k``: weights w,
a target C and a constant k that know nothing of V. So noise of the reference shifts no minimum, and
derivatives come out in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrics.leaking import LIT_SHARE, SIGMA_COUNT
from metrics.luminance import luminance
from metrics.squared_error import EXPOSURE_INVARIANT_SHARE

LEAST_BATCHES = 4
"""Each half of the batches has to tell its own noise."""

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Target:
    """The reference of a view, [y, x, rgb] or [y, x].

    Attributes
    ----------
    weights, centre, constant
        w, C and k of the error.
    batch_pulls
        [batch, y, x, rgb] what each batch adds to ``w C``, less the mean of its half: the noise.
    batch_factors
        [batch] one over M (M - 1), M being the batches of its half.
    dark_limit, missing_limit
        Luminance above which a dark pixel has too much, and below which one has too little: mean
        and three standard errors.
    is_dark
        Where the reference is below a twentieth of its mean.
    light
        Sum of the reference's luminance.
    """

    weights: Array
    centre: Array
    constant: float
    batch_pulls: Array
    batch_factors: Array
    dark_limit: Array
    missing_limit: Array
    is_dark: NDArray[np.bool_]
    light: float

    def error(self, image: Array) -> float:
        """Return the debiased relative squared error of a picture; below 0 it is noise."""
        return self.squares(image) + self.constant

    def squares(self, image: Array) -> float:
        """Return the part of it that depends on the picture, >= 0."""
        return float(np.mean(self.weights * (image - self.centre) ** 2))

    def common_error(self, image: Array, other: Array) -> float:
        """Return the error that two pictures share: independent noise of theirs has no part in it.

        The same picture twice gives `error`.
        """
        product = (image - self.centre) * (other - self.centre)
        return float(np.mean(self.weights * product)) + self.constant

    def pull(self, image: Array) -> Array:
        """Return the derivative of the error by each value of the picture, [y, x, rgb]."""
        found: Array = 2.0 / image.size * self.weights * (image - self.centre)
        return found

    def excess(self, image: Array) -> tuple[float, float]:
        """Return light where it is dark, and light that is missing, over all light."""
        over, under = self._excess_maps(luminance(image))
        return float(over.sum() / self.light), float(under.sum() / self.light)

    def excess_slopes(self, image: Array, columns: Array) -> tuple[Array, Array]:
        """Return derivatives of both, [parameter], from columns [parameter, y, x, rgb]."""
        over, under = self._excess_maps(luminance(image))
        changes = np.stack([luminance(column) for column in columns])
        return (
            (changes * (over > 0.0)).sum(axis=(1, 2)) / self.light,
            -(changes * (under > 0.0)).sum(axis=(1, 2)) / self.light,
        )

    def _excess_maps(self, seen: Array) -> tuple[Array, Array]:
        over = np.where(self.is_dark, np.maximum(seen - self.dark_limit, 0.0), 0.0)
        return over, np.maximum(self.missing_limit - seen, 0.0)


def make_target(batches: NDArray[np.floating]) -> Target:
    """Return the target of a view from independent references [batch, y, x, rgb].

    Raises
    ------
    ValueError
        Fewer than four batches, or a half of them without light.
    """
    values = np.asarray(batches, dtype=np.float64)
    count = len(values)
    if count < LEAST_BATCHES:
        raise ValueError(
            f"batches must be at least {LEAST_BATCHES}, got {count}: weights come from a half that "
            "is independent of the other, and each needs its own noise."
        )
    halves = (values[: count // 2], values[count // 2 :])
    weights = [_weights(half) for half in halves]
    centre_sum = np.zeros(values.shape[1:])
    constant, pulls, factors = 0.0, [], []
    for half, weight in zip(halves, reversed(weights), strict=True):
        mean, size = half.mean(axis=0), len(half)
        variance = half.var(axis=0, ddof=1) / size
        centre_sum += 0.5 * weight * mean
        constant += float(np.mean(0.5 * weight * (mean**2 - variance)))
        pulls += [0.5 * weight * (batch - mean) for batch in half]
        factors += [1.0 / (size * (size - 1))] * size
    total = 0.5 * (weights[0] + weights[1])
    centre = centre_sum / total
    lights = luminance(values)
    mean_light = lights.mean(axis=0)
    noise = SIGMA_COUNT * lights.std(axis=0, ddof=1) / np.sqrt(count)
    return Target(
        weights=total,
        centre=centre,
        constant=constant - float(np.mean(total * centre**2)),
        batch_pulls=np.stack(pulls),
        batch_factors=np.array(factors),
        dark_limit=mean_light + noise,
        missing_limit=mean_light - noise,
        is_dark=mean_light < LIT_SHARE * mean_light.mean(),
        light=float(mean_light.sum()),
    )


def _weights(half: Array) -> Array:
    """One over R^2 + eps, eps following the exposure, as in `metrics.relmse_e2`."""
    mean = half.mean(axis=0)
    light = float(luminance(mean).mean())
    if not light > 0.0:
        raise ValueError(
            "batches must hold light in both halves: a relative error to a black reference has no "
            "value; choose a view that sees indirect diffuse light, or more paths."
        )
    found: Array = 1.0 / (mean**2 + EXPOSURE_INVARIANT_SHARE * light**2)
    return found
