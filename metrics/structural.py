"""SSIM on PQ-encoded display luminance.

SSIM has constants that belong to a data range, so it means nothing on radiance without one. The
PQ code of absolute luminance is close to uniform for the eye and has the range 1.

References
----------
Wang, Bovik, Sheikh, Simoncelli (2004), "Image quality assessment: from error visibility to
structural similarity"; SMPTE ST 2084 for PQ.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.confidence import jackknife_of_mean
from metrics.display import PEAK_NITS, display_nits
from metrics.images import Image, checked_inputs
from metrics.luminance import luminance
from metrics.measurement import Measurement

WINDOW_SIGMA = 1.5
"""Standard deviation of SSIM's Gaussian window, pixels, as in the paper."""
WINDOW_SIZE = 11
"""Width of that window where scikit-image cuts it off, at 3.5 standard deviations."""

_PQ_M1 = 2610 / 16384
_PQ_M2 = 2523 / 4096 * 128
_PQ_C1 = 3424 / 4096
_PQ_C2 = 2413 / 4096 * 32
_PQ_C3 = 2392 / 4096 * 32
_PQ_PEAK_NITS = 10000.0


def pq_from_nits(nits: NDArray[np.float64]) -> NDArray[np.float64]:
    """PQ code in [0, 1] of absolute luminance, the inverse EOTF of SMPTE ST 2084.

    Parameters
    ----------
    nits
        Luminance, cd/m^2, in [0, 10000].
    """
    power = (nits / _PQ_PEAK_NITS) ** _PQ_M1
    return ((_PQ_C1 + _PQ_C2 * power) / (1.0 + _PQ_C3 * power)) ** _PQ_M2


def ssim_pq(
    test: ArrayLike, batches: ArrayLike, *, nits_per_unit: float, component: str = "image"
) -> Measurement:
    """Mean structural similarity of PQ-encoded luminance; 1 where the images are equal.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``, at least 11 x 11 pixels.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 2.
    nits_per_unit
        Display luminance of radiance 1, cd/m^2.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input, or an image smaller than the window.
    """
    checked_test, checked = checked_inputs(test, batches)
    height, width = checked_test.shape[:2]
    if min(height, width) < WINDOW_SIZE:
        raise ValueError(
            f"test must be at least {WINDOW_SIZE} x {WINDOW_SIZE} pixels for SSIM's window, got "
            f"{width} x {height}: render at a higher resolution."
        )
    # Imported here because it is slow to import and most metrics do without it.
    from skimage.metrics import structural_similarity

    def encoded(image: Image) -> NDArray[np.float64]:
        return pq_from_nits(luminance(display_nits(image, nits_per_unit)))

    encoded_test = encoded(checked_test)

    def similarity(reference: Image) -> float:
        return float(
            structural_similarity(  # type: ignore[no-untyped-call]
                encoded_test,
                encoded(reference),
                data_range=1.0,
                gaussian_weights=True,
                sigma=WINDOW_SIGMA,
                use_sample_covariance=False,
            )
        )

    return Measurement.from_estimate(
        jackknife_of_mean(similarity, checked),
        name="ssim_pq",
        component=component,
        formula=(
            f"mean SSIM(V, R) of PQ luminance, {nits_per_unit:.6g} cd/m^2 per unit, clip at "
            f"{PEAK_NITS:g} cd/m^2, Gaussian window of sigma {WINDOW_SIGMA:g}, range 1"
        ),
        ideal=1.0,
    )
