"""Luminance of linear RGB, and which pixels count as lit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LUMINANCE_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
"""Rec. ITU-R BT.709: luminance of linear RGB with sRGB primaries."""

LIT_SHARE = 1e-4
"""A pixel is lit above this share of the 99th percentile of luminance.

Pixels without light would pull a median or a mean of logarithms to nothing.
"""


def luminance(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Luminance of linear RGB ``(..., 3)``, in the image's own unit, ``(...)``."""
    return np.asarray(image @ LUMINANCE_WEIGHTS)


def lit_luminance(reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Luminance of the lit pixels of a reference, as a flat array.

    Parameters
    ----------
    reference
        Linear RGB, ``(H, W, 3)``.

    Raises
    ------
    ValueError
        When no pixel is lit.
    """
    values = luminance(reference)
    lit = values[values > max(0.0, LIT_SHARE * float(np.percentile(values, 99)))]
    if lit.size == 0:
        raise ValueError(
            "reference must hold some light, got luminance of at most "
            f"{float(values.max()):g} in every pixel: exposure and display mapping follow from the "
            "reference, take them from a component that is lit, such as the whole image."
        )
    return lit
