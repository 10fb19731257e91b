"""B3: banding as a display shows it, after CAMBI: flat patches that differ by a few codes.

A cross-check in the space of the display, not a measure of the march: it needs *quantised flats*,
patches of equal 10-bit code. Bands that are smooth, as most of those of cones are, leave no such
patch at their slopes and are not seen however strong they are; `metrics.moving_bands` sees those.
And every smooth picture has some codes' steps, so only what a picture has beyond its reference
counts.

References
----------
Tandon, Afonso, Sole, Krasula (2021), "CAMBI: Contrast-aware Multiscale Banding Index", arXiv
2102.00079, and the description of Netflix/vmaf, `resource/doc/cambi.md`: five scales of weights 16
to 1, ``c = w p0 pk / (p0 + pk)``, the mean of the largest 60 %, ``max(0, test - reference)``.
Written anew from these descriptions. Left out are the anti-dither filter, as these codes are exact,
the filter between scales, and the visibility threshold of dark codes; so values compare with one
another and not with those of the library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter

from metrics.display import display_nits
from metrics.images import Image, checked_image, checked_inputs
from metrics.luminance import luminance
from metrics.measurement import Measurement
from metrics.structural import pq_from_nits

SCALE_WEIGHTS = (16.0, 8.0, 4.0, 2.0, 1.0)
"""Of the whole picture, of every second pixel, and so on: wide bands are found at any."""

CONTRAST_WEIGHTS = (1.0, 2.0, 3.0, 4.0)
"""Of neighbours that differ by so many codes."""

LARGEST_CODE = 1023
"""10 bits."""

FLAT_WINDOW = 7
"""Pixels along the edge of the window that must be flat around a pixel."""

WINDOW = 63
"""Pixels along the edge of the window in which codes are counted."""

TOP_SHARE = 0.6
"""Share of the pixels, the worst ones, of which the mean is taken."""

FORMULA = "max(0, index of V - index of R) on 10-bit PQ luma, after CAMBI"

Codes = NDArray[np.int64]


def display_codes(image: ArrayLike, *, nits_per_unit: float) -> Codes:
    """Return 10-bit codes of PQ luminance, ``(H, W)``.

    Parameters
    ----------
    image
        Linear RGB, ``(H, W, 3)``; below zero is black.
    nits_per_unit
        Display luminance of radiance 1, cd/m^2.

    Raises
    ------
    ValueError
        For illegal input.
    """
    checked = checked_image(image, "image")
    encoded = pq_from_nits(luminance(display_nits(checked, nits_per_unit)))
    return np.rint(LARGEST_CODE * encoded).astype(np.int64)


def display_banding(image: ArrayLike, *, nits_per_unit: float) -> float:
    """Return the banding index of one picture: 0 for none.

    Parameters
    ----------
    image
        Linear RGB, ``(H, W, 3)``, at least 63 x 63 pixels.
    nits_per_unit
        Display luminance of radiance 1, cd/m^2.

    Raises
    ------
    ValueError
        For illegal input or a picture smaller than the window.
    """
    return banding_index(display_codes(image, nits_per_unit=nits_per_unit))


def display_banding_excess(
    test: ArrayLike, batches: ArrayLike, *, nits_per_unit: float, component: str = "image"
) -> Measurement:
    """B3: banding index of a picture beyond that of the mean of its reference.

    Without an interval: noise breaks the flats of a reference, so a noisy one has too few, and the
    value is at most too large by the index of the test itself.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``, at least 63 x 63 pixels.
    batches
        Reference, ``(M, H, W, 3)``, M >= 1.
    nits_per_unit
        Display luminance of radiance 1, cd/m^2.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input or a picture smaller than the window.
    """
    checked, reference = checked_inputs(test, batches, least=1)
    mean: Image = reference.mean(axis=0)
    found = display_banding(checked, nits_per_unit=nits_per_unit)
    known = display_banding(mean, nits_per_unit=nits_per_unit)
    return Measurement(
        name="display_banding_excess",
        component=component,
        value=max(0.0, found - known),
        low=None,
        high=None,
        formula=FORMULA,
        unit="",
        ideal=0.0,
        note="blind to bands without quantised flats",
    )


def banding_index(codes: Codes) -> float:
    """Return the index of a picture of codes, ``(H, W)``, both at least 63.

    Raises
    ------
    ValueError
        For another shape.
    """
    if codes.ndim != 2 or min(codes.shape) < WINDOW:
        raise ValueError(
            f"a picture must have at least {WINDOW} x {WINDOW} pixels for the window in which its "
            f"codes are counted, got {codes.shape}: render at a higher resolution."
        )
    return float(
        sum(
            weight * _pooled(_contrasts(codes[:: 2**scale, :: 2**scale]))
            for scale, weight in enumerate(SCALE_WEIGHTS)
        )
    )


def _contrasts(codes: Codes) -> NDArray[np.float64]:
    """Return c of every pixel; 0 where it is not flat around it."""
    is_flat = _is_flat(codes)
    found: NDArray[np.float64] = np.zeros(codes.shape)
    for code in np.unique(codes[is_flat]):
        here = is_flat & (codes == code)
        own = _share(here)
        for difference, weight in enumerate(CONTRAST_WEIGHTS, start=1):
            for neighbour in (code - difference, code + difference):
                other = is_flat & (codes == neighbour)
                if other.any():
                    beside = _share(other)
                    both = own + beside
                    contrast = weight * own * beside / np.where(both > 0.0, both, 1.0)
                    found[here] = np.maximum(found, contrast)[here]
    return found


def _is_flat(codes: Codes) -> NDArray[np.bool_]:
    """Whether most pixels of the window equal their right and lower neighbours."""
    right = np.diff(codes, axis=1, append=codes[:, -1:]) == 0
    down = np.diff(codes, axis=0, append=codes[-1:]) == 0
    # Counts are whole numbers: half a pixel keeps rounding from deciding.
    count = uniform_filter((right & down).astype(np.float64), FLAT_WINDOW, mode="nearest")
    least = (FLAT_WINDOW**2 // 2 + 0.5) / FLAT_WINDOW**2
    return np.asarray(count > least)


def _share(chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the share of the window around each pixel that is chosen; nothing lies outside."""
    shares = uniform_filter(chosen.astype(np.float64), WINDOW, mode="constant")
    return np.asarray(np.maximum(shares, 0.0))


def _pooled(contrasts: NDArray[np.float64]) -> float:
    """Mean of the largest."""
    count = max(1, round(TOP_SHARE * contrasts.size))
    return float(np.sort(contrasts, axis=None)[-count:].mean())
