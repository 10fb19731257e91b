"""HDR-FLIP with pinned exposures.

The `flip_evaluator` package ends the whole process on illegal settings and on exposures that it
has to compute from a black reference, reads RGBA as if it were RGB, gives 0 for a single exposure,
and hides NaN. Everything it is given is therefore checked here first, and the exposures are always
pinned: two images are comparable only if both were seen through the same ones.

References
----------
Andersson, Nilsson, Akenine-Moeller, Oskarsson, Astrom, Fairchild (2020), "FLIP: A difference
evaluator for alternating images"; Andersson, Nilsson, Shirley, Akenine-Moeller (2021),
"Visualizing errors in rendered high dynamic range images".
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, isfinite, log2, sqrt

import flip_evaluator
import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.confidence import jackknife_of_distance
from metrics.images import Image, checked_image, checked_inputs, checked_pair
from metrics.luminance import lit_luminance
from metrics.measurement import Measurement

DEFAULT_PIXELS_PER_DEGREE = 67.0206
"""A 3840-pixel display 0.7 m wide seen from 0.7 m, FLIP's own default."""

INTERVAL_PIXEL_LIMIT = 128 * 128
"""Largest image whose mean FLIP gets an interval, which costs M + 1 more evaluations."""

EXPOSED_WHITE = 0.85
"""Tone-mapped value to which the first exposure takes the brightest pixel, the last the median."""

_ACES = (0.9036, 0.018, 0.8748, 0.354, 0.14)
"""a, b, c, d, e of FLIP's ACES curve (a x^2 + b x) / (c x^2 + d x + e)."""


@dataclass(frozen=True, kw_only=True)
class FlipSettings:
    """How FLIP looks at a pair of images; two FLIP values with other settings do not compare."""

    start_exposure: float
    """First exposure, stops."""
    stop_exposure: float
    """Last exposure, stops, at least the first."""
    exposure_count: int
    """Exposures, evenly spaced, at least 2."""
    pixels_per_degree: float
    """Pixels in a degree of the viewer's visual angle, above 0."""

    def __post_init__(self) -> None:
        if not (isfinite(self.start_exposure) and isfinite(self.stop_exposure)):
            raise ValueError(
                "FlipSettings.start_exposure and stop_exposure must be finite, got "
                f"{self.start_exposure} and {self.stop_exposure}: take them from flip_exposures."
            )
        if self.stop_exposure < self.start_exposure:
            raise ValueError(
                f"FlipSettings.stop_exposure must be at least start_exposure, got "
                f"{self.stop_exposure} < {self.start_exposure}: exchange them."
            )
        if self.exposure_count < 2:
            raise ValueError(
                f"FlipSettings.exposure_count must be at least 2, got {self.exposure_count}: with "
                "one exposure flip_evaluator calls any two images equal."
            )
        if not (isfinite(self.pixels_per_degree) and self.pixels_per_degree > 0):
            raise ValueError(
                "FlipSettings.pixels_per_degree must be finite and above 0, got "
                f"{self.pixels_per_degree}: a desktop display has about 67."
            )


@dataclass(frozen=True)
class FlipResult:
    """Perceived difference per pixel, and its mean."""

    error_map: NDArray[np.float32]
    """``(H, W)`` in [0, 1], the largest over the exposures."""
    mean: float
    """Mean of the map."""


def flip_exposures(reference: ArrayLike) -> tuple[float, float, int]:
    """Exposures at which a viewer would look at a reference: first, last, count.

    The first takes its brightest pixel, the last its median lit pixel to 0.85 after ACES tone
    mapping, one exposure per stop between them. As FLIP does it, but for the median, which here
    leaves out unlit pixels: a picture that is black by half would otherwise be lifted by 20 stops.

    Parameters
    ----------
    reference
        Linear RGB, ``(H, W, 3)``; the whole image rather than a component.

    Returns
    -------
    tuple[float, float, int]
        Start and stop in stops, and the number of exposures, at least 2.

    Raises
    ------
    ValueError
        For illegal input or a reference without light.
    """
    lit = lit_luminance(checked_image(reference, "reference"))
    a, b, c, d, e = _ACES
    square = a - EXPOSED_WHITE * c
    linear = b - EXPOSED_WHITE * d
    constant = -EXPOSED_WHITE * e
    exposed = (-linear + sqrt(linear**2 - 4 * square * constant)) / (2 * square)
    start = log2(exposed / float(lit.max()))
    stop = log2(exposed / float(np.median(lit)))
    return start, stop, max(2, ceil(stop - start))


def flip(test: ArrayLike, reference: ArrayLike, settings: FlipSettings) -> FlipResult:
    """HDR-FLIP of two linear images.

    Values below zero, which no display can show, count as black.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    reference
        Linear RGB, ``(H, W, 3)``; may be black, because the exposures are pinned.
    settings
        Exposures and viewing distance.

    Raises
    ------
    ValueError
        For illegal input.
    """
    checked_test, checked_reference = checked_pair(test, reference)
    error_map, mean, used = flip_evaluator.evaluate(
        _for_evaluator(checked_reference, "reference"),
        _for_evaluator(checked_test, "test"),
        "HDR",
        applyMagma=False,
        parameters={
            "ppd": settings.pixels_per_degree,
            "startExposure": settings.start_exposure,
            "stopExposure": settings.stop_exposure,
            "numExposures": settings.exposure_count,
            "tonemapper": "aces",
        },
    )
    assert used["numExposures"] == settings.exposure_count, "flip_evaluator chose its own exposures"
    return FlipResult(error_map=np.asarray(error_map, dtype=np.float32)[..., 0], mean=float(mean))


def mean_flip(
    test: ArrayLike,
    batches: ArrayLike,
    settings: FlipSettings,
    *,
    component: str = "image",
    interval_pixel_limit: int = INTERVAL_PIXEL_LIMIT,
) -> Measurement:
    """Mean HDR-FLIP of the test against the mean of the batches.

    With an interval, and the first-order bias of reference noise removed, where the image has at
    most `interval_pixel_limit` pixels. Above that the M + 1 further evaluations cost seconds, and
    the value is the plain mean of the map, which holds the reference's noise.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 2.
    settings
        Exposures and viewing distance.
    component
        Name of what is compared, for the record.
    interval_pixel_limit
        Largest ``H * W`` that gets an interval.

    Raises
    ------
    ValueError
        For illegal input.
    """
    checked_test, checked = checked_inputs(test, batches)
    formula = (
        f"mean HDR-FLIP(V, R), {settings.exposure_count} exposures from "
        f"{settings.start_exposure:.3f} to {settings.stop_exposure:.3f} stops, ACES, "
        f"{settings.pixels_per_degree:g} pixels per degree"
    )
    if checked_test.shape[0] * checked_test.shape[1] > interval_pixel_limit:
        return Measurement(
            name="flip",
            component=component,
            value=flip(checked_test, checked.mean(axis=0), settings).mean,
            low=None,
            high=None,
            formula=formula,
            unit="",
            ideal=0.0,
            note=f"no interval above {interval_pixel_limit} pixels; holds the reference's noise",
        )

    def flip_of(first: Image, second: Image) -> float:
        return flip(first, second, settings).mean

    return Measurement.from_estimate(
        jackknife_of_distance(flip_of, lambda image: image, checked_test, checked),
        name="flip",
        component=component,
        formula=formula,
        ideal=0.0,
    )


def _for_evaluator(image: Image, name: str) -> NDArray[np.float32]:
    largest = float(np.finfo(np.float32).max)
    if float(image.max()) > largest:
        raise ValueError(
            f"{name} must stay below {largest:.3g}, got {float(image.max()):.3g}: FLIP works in "
            "32-bit floats."
        )
    return np.ascontiguousarray(np.maximum(image, 0.0), dtype=np.float32)
