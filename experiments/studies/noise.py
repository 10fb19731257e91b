"""Studies compare with a path tracer only where its noise leaves something to see."""

from __future__ import annotations

import numpy as np

from metrics.squared_error import relmse_e2
from reference.noise import NoisyReferenceError, require_low_noise_of


def require_told_apart(
    light: np.ndarray, batches: np.ndarray, samples_per_pixel: int, name: str
) -> None:
    """Refuse a comparison whose difference is not well above the noise of its reference.

    Parameters
    ----------
    light
        What is compared, ``[..., rgb]``.
    batches
        The reference, ``[batch, ..., rgb]``, at least 4 batches.
    samples_per_pixel
        Paths that it took for each pixel or point.
    name
        What the message calls the reference.

    Raises
    ------
    NoisyReferenceError
        Its noise is not ten times below the difference between the two, both as relMSE, or hides
        it: what is then measured would be the noise. A study shows such a row as refused.
    """
    rows = (-1, 1, 3)
    difference = relmse_e2(light.reshape(rows), batches.reshape(len(batches), *rows)).value
    if not difference > 0.0:
        raise NoisyReferenceError(
            f"{name} is too noisy to compare: nothing is left of the difference, a relMSE of "
            f"{difference:.2g} with the noise taken off; render more than {samples_per_pixel} "
            "paths a pixel."
        )
    require_low_noise_of(batches, samples_per_pixel, difference, name)
