"""What a cone set makes of the first spherical harmonics, against the exact cosine integral."""

from __future__ import annotations

import math

import numpy as np

from vctgi.maths.cones import ConeSet

EXACT_SHARE = {1: 2.0 / 3.0, 2: 1.0 / 4.0}
"""E / pi at the pole of a radiance field P_l(cos theta): the integral of 2 x P_l(x) over [0, 1]."""

NORMAL_COUNT = 500
"""Normals over which sets are averaged that belong to the world."""

POLE = np.array([[0.0, 0.0, 1.0]])


def smoothed(band: int, aperture: float) -> float:
    """Mean of P_l over a cone around the pole: how much of a band a cone keeps."""
    cosine = math.cos(0.5 * aperture)
    return 0.5 * (1.0 + cosine) if band == 1 else 0.5 * cosine * (1.0 + cosine)


def harmonics(band: int, d: np.ndarray) -> np.ndarray:
    """Real harmonics [direction, m] of band 1 or 2 with mean square 1 over the sphere."""
    x, y, z = d.T
    if band == 1:
        return math.sqrt(3.0) * np.stack([x, y, z], axis=1)
    scale = math.sqrt(15.0)
    zonal = math.sqrt(5.0) * (1.5 * z * z - 0.5)
    rows = [scale * x * y, scale * y * z, scale * x * z, 0.5 * scale * (x * x - y * y), zonal]
    return np.stack(rows, axis=1)


def band_error(cones: ConeSet, band: int, gain: float = 1.0) -> float:
    """Root mean square error of E / pi over all unit radiance fields of a band.

    Parameters
    ----------
    cones
        A set; the mean square is also over normals if it belongs to the world.
    band
        1 or 2.
    gain
        Factor on the weights.
    """
    normals = POLE if cones.frame == "tangent" else even_normals(NORMAL_COUNT)
    kept = np.array([smoothed(band, aperture) for aperture in cones.apertures])
    terms = harmonics(band, np.array(cones.directions))
    weights = normalised_weights(cones, normals)
    found = (gain * weights * kept) @ terms
    exact = harmonics(band, normals) * EXACT_SHARE[band]
    return float(np.sqrt(np.mean((found - exact) ** 2)))


def normalised_weights(cones: ConeSet, normals: np.ndarray) -> np.ndarray:
    """Weights [normal, cone] that a set has for each normal [normal, 3]."""
    if cones.frame == "tangent":
        return np.repeat(np.array(cones.weights)[None], len(normals), axis=0)
    cosines = np.maximum(normals @ np.array(cones.directions).T, 0.0)
    found: np.ndarray = cosines / cosines.sum(axis=1, keepdims=True)
    return found


def even_normals(count: int) -> np.ndarray:
    """Return unit vectors [count, 3] along a spiral that covers the sphere evenly."""
    place = (np.arange(count) + 0.5) / count
    phi = 2.0 * math.pi * np.arange(count) * 0.5 * (math.sqrt(5.0) - 1.0)
    z = 1.0 - 2.0 * place
    sine = np.sqrt(1.0 - z * z)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=1)
