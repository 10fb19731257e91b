"""From radiance to what a viewer sees: display luminance, exposure, sRGB pictures.

Perceptual metrics need cd/m^2 on a display, which a scene in W m^-2 sr^-1 does not state. The
mapping is chosen once from the reference of the whole image, recorded, and used for every
component and method of that scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, log2

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.images import Image, checked_image
from metrics.luminance import lit_luminance
from metrics.perceptual import DEFAULT_PIXELS_PER_DEGREE, FlipSettings, flip_exposures

MIDDLE_GREY_NITS = 18.0
"""Display luminance of the reference's log-mean luminance, cd/m^2."""
PEAK_NITS = 1000.0
"""Brightest the display can be, per channel, cd/m^2; above it everything looks alike."""
MIDDLE_GREY = 0.18
"""Linear value that `auto_exposure` gives to the reference's log-mean luminance."""


@dataclass(frozen=True, kw_only=True)
class DisplaySettings:
    """How the images of one scene are shown; the same for all its components and methods."""

    nits_per_unit: float
    """Display luminance of radiance 1, cd/m^2, above 0."""
    exposure: float
    """Exposure of the tone-mapped pictures, stops."""
    flip_start_exposure: float
    """First exposure of FLIP, stops."""
    flip_stop_exposure: float
    """Last exposure of FLIP, stops."""
    flip_exposure_count: int
    """Exposures of FLIP, at least 2."""
    flip_pixels_per_degree: float
    """Pixels in a degree of the viewer's visual angle, above 0."""

    def __post_init__(self) -> None:
        require_nits_per_unit(self.nits_per_unit)
        _require_exposure(self.exposure)
        _ = self.flip

    @property
    def flip(self) -> FlipSettings:
        """The part that FLIP needs."""
        return FlipSettings(
            start_exposure=self.flip_start_exposure,
            stop_exposure=self.flip_stop_exposure,
            exposure_count=self.flip_exposure_count,
            pixels_per_degree=self.flip_pixels_per_degree,
        )


def display_settings(
    reference: ArrayLike, *, pixels_per_degree: float = DEFAULT_PIXELS_PER_DEGREE
) -> DisplaySettings:
    """Display settings that follow from the reference of the whole image.

    Parameters
    ----------
    reference
        Linear RGB, ``(H, W, 3)``: emission, direct and indirect light together.
    pixels_per_degree
        Pixels in a degree of the viewer's visual angle.

    Raises
    ------
    ValueError
        For illegal input or a reference without light.
    """
    start, stop, count = flip_exposures(reference)
    return DisplaySettings(
        nits_per_unit=nits_per_unit(reference),
        exposure=auto_exposure(reference),
        flip_start_exposure=start,
        flip_stop_exposure=stop,
        flip_exposure_count=count,
        flip_pixels_per_degree=pixels_per_degree,
    )


def nits_per_unit(reference: ArrayLike) -> float:
    """Display luminance of radiance 1 that puts the log-mean lit luminance at 18 cd/m^2.

    Parameters
    ----------
    reference
        Linear RGB, ``(H, W, 3)``.

    Returns
    -------
    float
        cd/m^2 for each unit of radiance. The display's peak is `PEAK_NITS`.

    Raises
    ------
    ValueError
        For illegal input or a reference without light.
    """
    return MIDDLE_GREY_NITS / _log_mean_luminance(reference)


def auto_exposure(reference: ArrayLike) -> float:
    """Exposure in stops that puts the log-mean lit luminance at linear 0.18.

    Raises
    ------
    ValueError
        For illegal input or a reference without light.
    """
    return log2(MIDDLE_GREY / _log_mean_luminance(reference))


def display_nits(image: NDArray[np.float64], nits_per_unit: float) -> NDArray[np.float64]:
    """Light that the display emits for linear RGB: between nothing and its peak.

    Parameters
    ----------
    image
        Linear RGB, ``(..., 3)``.
    nits_per_unit
        Display luminance of radiance 1, cd/m^2.

    Returns
    -------
    NDArray[np.float64]
        cd/m^2 in [0, `PEAK_NITS`], per channel.

    Raises
    ------
    ValueError
        When `nits_per_unit` is not finite and above 0.
    """
    require_nits_per_unit(nits_per_unit)
    return np.clip(image * nits_per_unit, 0.0, PEAK_NITS)


def exposed(image: NDArray[np.float64], exposure_stops: float) -> NDArray[np.float64]:
    """Linear RGB of a standard display at an exposure, clipped to [0, 1].

    Raises
    ------
    ValueError
        When the exposure is not finite.
    """
    _require_exposure(exposure_stops)
    scale: float = 2.0**exposure_stops
    return np.clip(image * scale, 0.0, 1.0)


def srgb_from_linear(image: ArrayLike, exposure_stops: float) -> Image:
    """Picture of a linear image: exposure, clip to the display's range, sRGB encoding.

    No tone curve: what is not clipped keeps its ratios, so that two pictures side by side differ
    as the images do.

    Parameters
    ----------
    image
        Linear RGB, ``(H, W, 3)``.
    exposure_stops
        Exposure in stops; `auto_exposure` gives a sensible one.

    Returns
    -------
    NDArray[np.float64]
        sRGB-encoded values in [0, 1], ``(H, W, 3)``.

    Raises
    ------
    ValueError
        For illegal input or an exposure that is not finite.

    References
    ----------
    IEC 61966-2-1
    """
    linear = exposed(checked_image(image, "image"), exposure_stops)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def require_nits_per_unit(nits_per_unit: float) -> None:
    """Refuse a display mapping that is none.

    Raises
    ------
    ValueError
        When it is not finite and above 0.
    """
    if not (isfinite(nits_per_unit) and nits_per_unit > 0):
        raise ValueError(
            f"nits_per_unit must be finite and above 0, got {nits_per_unit}: take it from "
            "metrics.nits_per_unit(reference)."
        )


def _require_exposure(stops: float) -> None:
    if not isfinite(stops):
        raise ValueError(
            f"exposure must be a finite number of stops, got {stops}: take it from "
            "metrics.auto_exposure(reference)."
        )


def _log_mean_luminance(reference: ArrayLike) -> float:
    return float(np.exp(np.log(lit_luminance(checked_image(reference, "reference"))).mean()))
