"""Colour differences: delta E ITP for absolute luminance, delta E 2000 for pictures.

References
----------
Rec. ITU-R BT.2124 (delta E ITP; 1 is about one just noticeable difference); Rec. ITU-R BT.2087
(BT.709 to BT.2020 primaries); CIE 142-2001 (delta E 2000).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.confidence import jackknife_of_distance
from metrics.display import PEAK_NITS, display_nits, exposed
from metrics.images import Image, checked_inputs
from metrics.measurement import Measurement

BT2020_FROM_BT709 = np.array(
    [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
)
"""Rec. ITU-R BT.2087: linear RGB from sRGB primaries to BT.2020; rows add up to 1."""


def delta_e_itp(
    test: ArrayLike, batches: ArrayLike, *, nits_per_unit: float, component: str = "image"
) -> Measurement:
    """Mean delta E ITP on a display with absolute luminance; 1 is about just noticeable.

    A distance, so noise of the reference adds to it; `metrics.confidence.jackknife_of_distance`
    says how value and interval treat that.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 2.
    nits_per_unit
        Display luminance of radiance 1, cd/m^2.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input.
    """
    checked_test, checked = checked_inputs(test, batches)
    # Imported here because it is slow to import and most metrics do without it.
    from colour.difference import delta_E_ITP
    from colour.models import RGB_to_ICtCp

    def ictcp(image: Image) -> NDArray[np.float64]:
        bt2020 = display_nits(image, nits_per_unit) @ BT2020_FROM_BT709.T
        return np.asarray(RGB_to_ICtCp(bt2020, method="ITU-R BT.2100-2 PQ"))

    def difference(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
        return float(np.mean(delta_E_ITP(first, second)))

    return Measurement.from_estimate(
        jackknife_of_distance(difference, ictcp, checked_test, checked),
        name="delta_e_itp",
        component=component,
        formula=(
            f"mean delta E ITP(V, R), {nits_per_unit:.6g} cd/m^2 per unit, clip at "
            f"{PEAK_NITS:g} cd/m^2"
        ),
        unit="JND",
        ideal=0.0,
    )


def delta_e_2000(
    test: ArrayLike, batches: ArrayLike, *, exposure: float, component: str = "image"
) -> Measurement:
    """Mean CIE delta E 2000 of the pictures as `metrics.display.srgb_from_linear` shows them.

    A distance, so noise of the reference adds to it; `metrics.confidence.jackknife_of_distance`
    says how value and interval treat that.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 2.
    exposure
        Exposure of the picture, stops; what it clips is not compared.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input.
    """
    checked_test, checked = checked_inputs(test, batches)
    # Imported here because it is slow to import and most metrics do without it.
    from colour.difference import delta_E_CIE2000
    from colour.models import RGB_to_XYZ, XYZ_to_Lab

    def lab(image: Image) -> NDArray[np.float64]:
        return np.asarray(XYZ_to_Lab(RGB_to_XYZ(exposed(image, exposure), "sRGB")))

    def difference(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
        return float(np.mean(delta_E_CIE2000(first, second)))

    return Measurement.from_estimate(
        jackknife_of_distance(difference, lab, checked_test, checked),
        name="delta_e_2000",
        component=component,
        formula=f"mean CIE delta E 2000 of sRGB pictures of V and R at {exposure:+.3f} stops",
        ideal=0.0,
    )
