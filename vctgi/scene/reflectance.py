"""What share of light a surface reflects, found by sampling its BSDF."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component, as_mask

ALBEDO_SAMPLES = 2
"""BSDF samples for each texel; many texels light a voxel."""


def hemispherical_albedo(
    si: mi.SurfaceInteraction3f, index: mi.UInt32, active: mi.Bool | bool = True
) -> mi.Color3f:
    """Share of the light from `si.wi` that a surface reflects, all reflecting lobes together.

    Exact for diffuse BSDFs, whose sample weight is their albedo; for others an unbiased estimate.
    0 for lanes that are not active.
    """
    bsdf = si.bsdf()
    albedo = mi.Color3f(0.0)
    for number in range(ALBEDO_SAMPLES):
        lobe = (number + random_unit(index, 3 * number)) / ALBEDO_SAMPLES
        point = mi.Point2f(random_unit(index, 3 * number + 1), random_unit(index, 3 * number + 2))
        sample, weight = bsdf.sample(
            mi.BSDFContext(), si, as_component(lobe), point, as_mask(active)
        )
        is_reflection = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Reflection)
        is_used = is_reflection & (sample.pdf > 0.0) & as_mask(active)
        albedo += dr.select(is_used, mi.Color3f(weight), 0.0) / ALBEDO_SAMPLES
    return albedo
