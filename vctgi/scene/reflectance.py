"""What share of light a surface reflects, found by sampling its BSDF."""

from __future__ import annotations

from collections.abc import Iterable

import drjit as dr
import mitsuba as mi

from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.materials import nested_bsdfs
from vctgi.scene.registry import read_by_number, registry_number, table_by_number

ALBEDO_SAMPLES = 2
"""BSDF samples for each texel; many texels light a voxel."""


SAMPLED, ONE_SIDED, TWO_SIDED = 0, 1, 2
"""How the albedo of a BSDF is found: by sampling it, or read, where it is a texture and no more."""


def list_plain_bsdfs(bsdfs: Iterable[mi.BSDF]) -> mi.UInt32:
    """Return how the albedo of each BSDF is found, by its number in Mitsuba's registry.

    Numbers of other BSDFs read `SAMPLED`, or lie behind the end.
    """
    found: dict[int, int] = {}
    for bsdf in bsdfs:
        sides = nested_bsdfs(bsdf) if bsdf.class_name() == "TwoSidedBRDF" else [bsdf]
        is_plain = all(each.class_name() == PLAIN for each in sides)
        kind = ONE_SIDED if sides[0] is bsdf else TWO_SIDED
        found[registry_number(mi.BSDFPtr(bsdf))] = kind if is_plain else SAMPLED
    return table_by_number(found, SAMPLED)


PLAIN = "SmoothDiffuse"
"""Mitsuba class that reflects a texture evenly and does nothing else."""


def plain_or_sampled_albedo(
    si: mi.SurfaceInteraction3f, index: mi.UInt32, plain: mi.UInt32, active: mi.Bool
) -> mi.Color3f:
    """Return `hemispherical_albedo`, without sampling the BSDFs that need none.

    Parameters
    ----------
    si, index, active
        As there.
    plain
        What `list_plain_bsdfs` returned for the BSDFs of the scene.
    """
    kind, is_listed = read_by_number(plain, si.bsdf(), active)
    is_read = is_listed & (kind != SAMPLED)
    cosine = mi.Frame3f.cos_theta(si.wi)
    is_front = (cosine > 0.0) | ((kind == TWO_SIDED) & (cosine < 0.0))
    read = si.bsdf().eval_diffuse_reflectance(si, as_mask(is_read & is_front))
    sampled = hemispherical_albedo(si, index, active & ~is_read)
    return dr.select(is_read & is_front, mi.Color3f(read), sampled)


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
