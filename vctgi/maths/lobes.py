"""Cones as wide as the lobes of microfacet surfaces: apertures by roughness and incidence.

The cone of a lobe has the lobe's spatial median as its axis, and holds half of its light within the
angle that holds half of an evenly lit cone. Matching medians, not means, keeps the long tail of GGX
from widening the cone: seen straight on with alpha 0.1, a GGX lobe holds half of its light within
11 degrees, which is a cone of 33 degrees, and the cone of the same mean direction has 56.

For GGX and Beckmann with the separable shadowing of Smith, axis and aperture follow from two
numbers, alpha and the cosine of incidence. They are integrated once over the half vectors, for a
perfect mirror and with the Fresnel factor of a dielectric, and interpolated in tables. Anisotropic
roughness has no table: a round cone cannot be as wide as a lobe in two directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.cones import GOLDEN_TURN
from vctgi.maths.constant_tables import constant_table

LobeDistribution = Literal["beckmann", "ggx"]
"""Distributions of microfacet normals that have a table."""

DISTRIBUTIONS: tuple[LobeDistribution, ...] = get_args(LobeDistribution)

TABLES = tuple((each, is_coat) for is_coat in (False, True) for each in DISTRIBUTIONS)
"""What the tables are of: a distribution, and whether with the Fresnel factor of a coat."""

COAT_IOR = 1.49
"""Index of refraction of coats, Mitsuba's default for plastics; other coats are read off the same
tables."""

ALPHA_COUNT, COSINE_COUNT = 18, 18
"""Rows and columns of a table, in the square roots of alpha and of the cosine of incidence."""

RADIUS_COUNT, AZIMUTH_COUNT = 64, 24
"""Half vectors of the integral: rings, and points on half of each ring."""

MEDIAN_STEPS = 16
"""Steps of the iteration for the spatial median [Weiszfeld1937]."""

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
        Angle between the normal and the axis, which lies in the plane of incidence; positive
        towards the mirrored direction.
    """

    aperture: float
    tilt: float


def lobe_cone(
    distribution: LobeDistribution, alpha: float, cosine: float, *, is_coat: bool = False
) -> LobeCone:
    """Integrate the cone of one lobe.

    Parameters
    ----------
    distribution
        Of the microfacets' normals.
    alpha
        Roughness, (0, 1].
    cosine
        Of the angle between the viewer and the normal, (0, 1].
    is_coat
        Whether each microfacet reflects as a dielectric of `COAT_IOR`, not all light.

    References
    ----------
    [Walter2007] B. Walter, S. Marschner, H. Li, K. Torrance, Microfacet models for refraction
    through rough surfaces, EGSR 2007.
    [Weiszfeld1937] E. Weiszfeld, Sur le point pour lequel la somme des distances de n points
    donnes est minimum, Tohoku Mathematical Journal 43, 1937.
    """
    # Slopes by inversion of their distribution, whose tail is long: the rings lie evenly in the
    # fourth root of the share outside of them. The lobe is symmetric about the plane of incidence.
    # Each azimuth has rings of its own, so that no two half vectors share an angle.
    shift = (np.arange(AZIMUTH_COUNT) * GOLDEN_TURN % 1.0)[None, :]
    root = (np.arange(RADIUS_COUNT)[:, None] + shift + 0.5 / AZIMUTH_COUNT) / RADIUS_COUNT
    outside, ring = root**4, root**3
    azimuth = math.pi * (np.arange(AZIMUTH_COUNT) + 0.5)[None, :] / AZIMUTH_COUNT
    if distribution == "ggx":
        slope = alpha * np.sqrt((1.0 - outside) / outside)
    else:
        slope = alpha * np.sqrt(-np.log(outside))
    z = 1.0 / np.sqrt(1.0 + slope**2)
    x, y = slope * z * np.cos(azimuth), slope * z * np.sin(azimuth)
    sine = math.sqrt(max(0.0, 1.0 - cosine**2))
    facing = sine * x + cosine * z
    # The viewer stands at (sine, 0, cosine); the mirrored direction leads to -x.
    out = np.stack([2.0 * facing * x - sine, 2.0 * facing * y, 2.0 * facing * z - cosine])
    is_seen = (facing > 0.0) & (out[2] > 0.0)
    unshadowed = _unshadowed(distribution, alpha, np.where(is_seen, out[2], 1.0))
    weight = np.where(is_seen, ring * facing / z * unshadowed, 0.0)
    if is_coat:
        weight = weight * _dielectric_fresnel(np.clip(facing, 0.0, 1.0))
    return cone_of_directions(out.reshape(3, -1), weight.ravel(), (-sine, 0.0, cosine))


def cone_of_directions(
    directions: np.ndarray, weights: np.ndarray, start: tuple[float, float, float]
) -> LobeCone:
    """Return the cone that holds half of the weight within the median angle of an even cone.

    Parameters
    ----------
    directions
        [3, point] unit vectors, symmetric about the plane y = 0, of which one side may be missing.
    weights
        [point], >= 0, not all 0.
    start
        First guess of the axis.
    """
    axis = np.array(start)
    for _ in range(MEDIAN_STEPS):
        chord = np.sqrt(((directions - axis[:, None]) ** 2).sum(axis=0)) + np.finfo(float).eps
        axis = (directions * (weights / chord)).sum(axis=1)
        axis[1] = 0.0
        axis /= math.hypot(axis[0], axis[2])
    # One less the cosine grows as the share of an evenly lit cone.
    height = 1.0 - axis @ directions
    order = np.argsort(height)
    reached = np.cumsum(weights[order])
    half = float(np.interp(0.5 * reached[-1], reached, height[order]))
    return LobeCone(2.0 * math.acos(max(-1.0, 1.0 - 2.0 * half)), math.atan2(-axis[0], axis[2]))


def _unshadowed(distribution: LobeDistribution, alpha: float, cosine: np.ndarray) -> np.ndarray:
    """Share of microfacets that see a direction, [Walter2007] equations 27 and 34."""
    tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / cosine
    if distribution == "ggx":
        unshadowed: np.ndarray = 2.0 / (1.0 + np.sqrt(1.0 + (alpha * tangent) ** 2))
        return unshadowed
    ratio = 1.0 / np.maximum(alpha * tangent, 1e-9)
    rational = (3.535 * ratio + 2.181 * ratio**2) / (1.0 + 2.276 * ratio + 2.577 * ratio**2)
    return np.where(ratio < 1.6, rational, 1.0)


def _dielectric_fresnel(cosine: np.ndarray) -> np.ndarray:
    """Share of unpolarized light that a dielectric of `COAT_IOR` reflects."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / COAT_IOR**2)
    across = (cosine - COAT_IOR * inside) / (cosine + COAT_IOR * inside)
    along = (COAT_IOR * cosine - inside) / (COAT_IOR * cosine + inside)
    share: np.ndarray = 0.5 * (across**2 + along**2)
    return share


@cache
def lobe_tables() -> tuple[np.ndarray, np.ndarray]:
    """Return relative apertures and tilts [table, alpha, cosine], in the order of `TABLES`.

    Apertures are over alpha and tilts over the angle of incidence, which leaves smooth functions.
    """
    shape = (len(TABLES), ALPHA_COUNT, COSINE_COUNT)
    apertures, tilts = np.empty(shape), np.empty(shape)
    for kind, (distribution, is_coat) in enumerate(TABLES):
        for row in range(ALPHA_COUNT):
            for column in range(COSINE_COUNT):
                alpha = max((row / (ALPHA_COUNT - 1)) ** 2, LEAST_ALPHA)
                cosine = max((column / (COSINE_COUNT - 1)) ** 2, LEAST_COSINE)
                cosine = min(cosine, math.sqrt(1.0 - LEAST_SINE**2))
                cone = lobe_cone(distribution, alpha, cosine, is_coat=is_coat)
                apertures[kind, row, column] = cone.aperture / alpha
                tilts[kind, row, column] = cone.tilt / math.acos(cosine)
    return apertures, tilts


def read_lobe_cone(
    table: mi.UInt32, alpha: mi.Float, cosine: mi.Float
) -> tuple[mi.Float, mi.Float]:
    """Interpolate the cone of lobes, one a lane.

    Parameters
    ----------
    table
        Places in `TABLES`.
    alpha, cosine
        Roughness and cosine of incidence; those outside [0, 1] are read at the table's rim.

    Returns
    -------
    tuple
        Aperture and tilt (`LobeCone`), radians.
    """
    apertures = constant_table("lobe apertures", lambda: mi.Float(lobe_tables()[0].ravel()))
    tilts = constant_table("lobe tilts", lambda: mi.Float(lobe_tables()[1].ravel()))
    row = dr.sqrt(dr.clip(alpha, 0.0, 1.0)) * (ALPHA_COUNT - 1)
    column = dr.sqrt(dr.clip(cosine, 0.0, 1.0)) * (COSINE_COUNT - 1)
    row_index = dr.minimum(mi.UInt32(row), ALPHA_COUNT - 2)
    column_index = dr.minimum(mi.UInt32(column), COSINE_COUNT - 2)
    row_share, column_share = row - mi.Float(row_index), column - mi.Float(column_index)
    first = (table * ALPHA_COUNT + row_index) * COSINE_COUNT + column_index

    def read(values: mi.Float) -> mi.Float:
        near, far = (
            dr.lerp(
                dr.gather(mi.Float, values, first + step),
                dr.gather(mi.Float, values, first + step + 1),
                column_share,
            )
            for step in (0, COSINE_COUNT)
        )
        return dr.lerp(near, far, row_share)

    return read(apertures) * dr.clip(alpha, 0.0, 1.0), read(tilts) * dr.safe_acos(cosine)
