"""Lobes of Mitsuba's own BSDFs, integrated direction by direction: what tables are held against."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.lobes import LobeCone, LobeDistribution, cone_of_directions

RING_COUNT, AZIMUTH_COUNT = 1024, 96
"""Half vectors of the integral: polar angles, and azimuths over half a turn."""


def true_lobe_cone(
    distribution: LobeDistribution, alpha: float, cosine: float, kind: str = "roughconductor"
) -> LobeCone:
    """Integrate the specular lobe of a BSDF as Mitsuba evaluates it.

    Parameters
    ----------
    distribution, alpha
        Of the microfacets' normals.
    cosine
        Of the angle between viewer and normal.
    kind
        "roughconductor", a perfect one, or "roughplastic", whose lobe has Fresnel's factor in it.
    """
    description: dict[str, Any] = {"type": kind, "alpha": alpha, "distribution": distribution}
    if kind == "roughconductor":
        description["material"] = "none"
    bsdf = mi.load_dict(description)
    # Polar angles of the half vectors lie close where the distribution is steep.
    share = (np.arange(RING_COUNT) + 0.5) / RING_COUNT
    polar = 0.5 * math.pi * share**3
    polar_step = 1.5 * math.pi * share**2 / RING_COUNT
    azimuth = math.pi * (np.arange(AZIMUTH_COUNT) + 0.5) / AZIMUTH_COUNT
    theta, phi = (each.ravel() for each in np.meshgrid(polar, azimuth, indexing="ij"))
    half = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    viewer = np.array([math.sqrt(1.0 - cosine**2), 0.0, cosine])
    facing = viewer @ half
    out = 2.0 * facing * half - viewer[:, None]
    is_seen = (facing > 0.0) & (out[2] > 0.0)
    si = dr.zeros(mi.SurfaceInteraction3f, len(theta))
    si.wi = mi.Vector3f(*viewer.tolist())
    context = mi.BSDFContext()
    context.type_mask = int(mi.BSDFFlags.GlossyReflection)
    value = bsdf.eval(context, si, mi.Vector3f(out.astype(np.float32)))
    # A solid angle of half vectors reflects into one 4 (i . h) as large.
    area = np.repeat(polar_step, AZIMUTH_COUNT) * np.sin(theta) * 4.0 * np.maximum(facing, 0.0)
    weight = np.where(is_seen, np.array(value, dtype=np.float64)[1] * area, 0.0)
    return cone_of_directions(out, weight, (-float(viewer[0]), 0.0, cosine))
