"""Cones as wide as the lobes of microfacet surfaces: apertures by roughness and incidence.

The cone of a lobe has the lobe's mean direction as its axis, and the aperture whose own mean
direction is as long (`vctgi.maths.cones.aperture_from_mean_cosine`). For GGX and Beckmann with the
separable shadowing of Smith both follow from two numbers, alpha and the cosine of incidence. They
are integrated once over the half vectors, without Fresnel's factor, and interpolated in a table.

Anisotropic roughness has no table: a round cone cannot be as wide as a lobe in two directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi
import numpy as np

LobeDistribution = Literal["beckmann", "ggx"]
"""Distributions of microfacet normals that have a table."""

DISTRIBUTIONS: tuple[LobeDistribution, ...] = get_args(LobeDistribution)

ALPHA_COUNT, COSINE_COUNT = 24, 24
"""Rows and columns of a table, in the square roots of alpha and of the cosine of incidence."""

RADIUS_COUNT, AZIMUTH_COUNT = 192, 48
"""Half vectors of the integral: rings, and points on half of each ring."""

LEAST_ALPHA, LEAST_COSINE, LEAST_SINE = 1e-4, 1e-3, 1e-3
"""Nearest to a mirror, to grazing and to normal incidence that a table's integral is taken."""


@dataclass(frozen=True)
class LobeCone:
    """The round cone of a lobe, angles in radians.

    Attributes
    ----------
    aperture
        Full apex angle.
    tilt
        Angle between the normal and the axis, which lies in the plane of incidence.
    """

    aperture: float
    tilt: float


def lobe_cone(distribution: LobeDistribution, alpha: float, cosine: float) -> LobeCone:
    """Integrate the cone of one lobe.

    Parameters
    ----------
    distribution
        Of the microfacets' normals.
    alpha
        Roughness, (0, 1].
    cosine
        Of the angle between the viewer and the normal, (0, 1].

    References
    ----------
    [Walter2007] B. Walter, S. Marschner, H. Li, K. Torrance, Microfacet models for refraction
    through rough surfaces, EGSR 2007.
    """
    # Slopes by inversion of their distribution, whose tail is long: the rings lie evenly in the
    # fourth root of the share outside of them. The lobe is symmetric about the plane of incidence.
    root = (np.arange(RADIUS_COUNT) + 0.5)[:, None] / RADIUS_COUNT
    outside, ring = root**4, root**3
    azimuth = math.pi * (np.arange(AZIMUTH_COUNT) + 0.5)[None, :] / AZIMUTH_COUNT
    if distribution == "ggx":
        slope = alpha * np.sqrt((1.0 - outside) / outside)
    else:
        slope = alpha * np.sqrt(-np.log(outside))
    z = 1.0 / np.sqrt(1.0 + slope**2)
    x = slope * z * np.cos(azimuth)
    sine = math.sqrt(max(0.0, 1.0 - cosine**2))
    facing = sine * x + cosine * z
    # The viewer stands at (sine, 0, cosine); the mirrored direction leads to -x.
    out_x, out_z = 2.0 * facing * x - sine, 2.0 * facing * z - cosine
    is_seen = (facing > 0.0) & (out_z > 0.0)
    out_z = np.where(is_seen, out_z, 1.0)
    weight = np.where(is_seen, ring * facing / z * _unshadowed(distribution, alpha, out_z), 0.0)
    total = weight.sum()
    along, up = -float((weight * out_x).sum() / total), float((weight * out_z).sum() / total)
    length = min(math.hypot(along, up), 1.0)
    return LobeCone(2.0 * math.acos(2.0 * length - 1.0), math.atan2(along, up))


def _unshadowed(distribution: LobeDistribution, alpha: float, cosine: np.ndarray) -> np.ndarray:
    """Share of microfacets that see a direction, [Walter2007] equations 27 and 34."""
    tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / cosine
    if distribution == "ggx":
        unshadowed: np.ndarray = 2.0 / (1.0 + np.sqrt(1.0 + (alpha * tangent) ** 2))
        return unshadowed
    ratio = 1.0 / np.maximum(alpha * tangent, 1e-9)
    rational = (3.535 * ratio + 2.181 * ratio**2) / (1.0 + 2.276 * ratio + 2.577 * ratio**2)
    return np.where(ratio < 1.6, rational, 1.0)


@cache
def lobe_tables() -> tuple[np.ndarray, np.ndarray]:
    """Return relative apertures and tilts [distribution, alpha, cosine], in `DISTRIBUTIONS` order.

    Apertures are over alpha and tilts over the angle of incidence, which leaves smooth functions.
    """
    shape = (len(DISTRIBUTIONS), ALPHA_COUNT, COSINE_COUNT)
    apertures, tilts = np.empty(shape), np.empty(shape)
    for kind, distribution in enumerate(DISTRIBUTIONS):
        for row in range(ALPHA_COUNT):
            for column in range(COSINE_COUNT):
                alpha = max((row / (ALPHA_COUNT - 1)) ** 2, LEAST_ALPHA)
                cosine = max((column / (COSINE_COUNT - 1)) ** 2, LEAST_COSINE)
                cosine = min(cosine, math.sqrt(1.0 - LEAST_SINE**2))
                cone = lobe_cone(distribution, alpha, cosine)
                apertures[kind, row, column] = cone.aperture / alpha
                tilts[kind, row, column] = cone.tilt / math.acos(cosine)
    return apertures, tilts


def read_lobe_cone(
    distribution: mi.UInt32, alpha: mi.Float, cosine: mi.Float
) -> tuple[mi.Float, mi.Float]:
    """Interpolate the cone of lobes, one a lane.

    Parameters
    ----------
    distribution
        Places in `DISTRIBUTIONS`.
    alpha, cosine
        Roughness and cosine of incidence; those outside [0, 1] are read at the table's rim.

    Returns
    -------
    tuple
        Aperture and tilt (`LobeCone`), radians.
    """
    apertures, tilts = (mi.Float(each.ravel()) for each in lobe_tables())
    row = dr.sqrt(dr.clip(alpha, 0.0, 1.0)) * (ALPHA_COUNT - 1)
    column = dr.sqrt(dr.clip(cosine, 0.0, 1.0)) * (COSINE_COUNT - 1)
    row_index = dr.minimum(mi.UInt32(row), ALPHA_COUNT - 2)
    column_index = dr.minimum(mi.UInt32(column), COSINE_COUNT - 2)
    row_share, column_share = row - mi.Float(row_index), column - mi.Float(column_index)
    first = (distribution * ALPHA_COUNT + row_index) * COSINE_COUNT + column_index

    def read(table: mi.Float) -> mi.Float:
        near, far = (
            dr.lerp(
                dr.gather(mi.Float, table, first + step),
                dr.gather(mi.Float, table, first + step + 1),
                column_share,
            )
            for step in (0, COSINE_COUNT)
        )
        return dr.lerp(near, far, row_share)

    return read(apertures) * dr.clip(alpha, 0.0, 1.0), read(tilts) * dr.safe_acos(cosine)
