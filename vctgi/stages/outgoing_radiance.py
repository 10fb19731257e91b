"""Outgoing radiance of lit points: what bounds the brightness of a voxel.

A texel of a shadow map knows its flux, not the area that it stands for, so sums of flux say nothing
about how bright the surface is at any point. The direct light of all emitters there does. It is
estimated with as many samples of emitters as of directions, weighed by the balance heuristic, so
that lamps of any size come out with little noise.
"""

from __future__ import annotations

import math
from dataclasses import replace

import drjit as dr
import mitsuba as mi

from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.records import ReflectiveShadowMap

SAMPLE_COUNT = 4
"""Samples of emitters and of directions for each texel."""

STREAM = 900
"""First hash stream of the samples."""


def with_radiance(
    scene: mi.Scene, maps: list[ReflectiveShadowMap], sample_count: int = SAMPLE_COUNT
) -> list[ReflectiveShadowMap]:
    """Return maps whose texels know the radiance of the surface that they lie on.

    Parameters
    ----------
    scene
        All emitters and what casts shadows.
    maps
        Lit points.
    sample_count
        Samples of emitters and of directions for each texel, >= 1. Many texels light a voxel.

    Notes
    -----
    Albedo is that of the texel itself, reflected over incident flux, channel by channel. The random
    numbers hash the texel's place: the same point of a surface gets the same estimate whatever else
    is in the map.

    References
    ----------
    [Veach1995] E. Veach, L. Guibas, Optimally combining sampling techniques for Monte Carlo
    rendering, SIGGRAPH 1995.
    """
    found = []
    for rsm in maps:
        is_lit = rsm.incident_flux > 0.0
        share = rsm.reflected_flux / dr.select(is_lit, rsm.incident_flux, 1.0)
        albedo = dr.select(is_lit, share, 0.0)
        irradiance = _irradiance(scene, rsm, sample_count)
        radiance = mi.Color3f(albedo * irradiance * (1.0 / math.pi))
        dr.eval(radiance)
        found.append(replace(rsm, radiance=radiance))
    return found


def _irradiance(scene: mi.Scene, rsm: ReflectiveShadowMap, sample_count: int) -> mi.Color3f:
    """Direct irradiance on the lit side of each texel, W m^-2."""
    si = dr.zeros(mi.SurfaceInteraction3f, rsm.texel_count)
    si.p, si.n = rsm.position, mi.Normal3f(rsm.normal)
    si.sh_frame = mi.Frame3f(rsm.normal)
    seed = _hash(rsm.position)
    total = dr.zeros(mi.Color3f, rsm.texel_count)
    for number in range(sample_count):
        stream = STREAM + 4 * number
        u, v, s, t = (random_unit(seed, stream + i) for i in range(4))
        total += _from_emitters(scene, si, mi.Point2f(u, v))
        total += _from_directions(scene, si, mi.Point2f(s, t))
        dr.eval(total)
    return total / sample_count


def _hash(position: mi.Point3f) -> mi.UInt32:
    """Return a number that is that of the place alone."""
    x, y, z = (
        mi.UInt32(dr.reinterpret_array(mi.UInt32, mi.Float(position[axis]))) for axis in range(3)
    )
    return x * 0x9E3779B1 + y * 0x85EBCA77 + z * 0xC2B2AE3D


def _from_emitters(scene: mi.Scene, si: mi.SurfaceInteraction3f, sample: mi.Point2f) -> mi.Color3f:
    found, weight = scene.sample_emitter_direction(si, sample, True)
    cosine = mi.Float(dr.maximum(mi.Frame3f.cos_theta(si.to_local(found.d)), 0.0))
    pdf = mi.Float(found.pdf)
    share = dr.select(mi.Bool(found.delta), 1.0, _heuristic(pdf, cosine / math.pi))
    light = mi.Color3f(weight) * as_component(cosine * share)
    # Nothing was sampled where the density is 0.
    return mi.Color3f(dr.select(pdf > 0.0, light, 0.0))


def _from_directions(
    scene: mi.Scene, si: mi.SurfaceInteraction3f, sample: mi.Point2f
) -> mi.Color3f:
    local = mi.warp.square_to_cosine_hemisphere(sample)
    ray = si.spawn_ray(si.sh_frame.to_world(local))
    hit = scene.ray_intersect(ray, as_mask(True))
    emitter = hit.emitter(scene)
    at_light = mi.DirectionSample3f(scene, hit, si)
    pdf = scene.pdf_emitter_direction(si, at_light)
    share = _heuristic(mi.Float(local.z) / math.pi, mi.Float(pdf))
    return mi.Color3f(emitter.eval(hit)) * math.pi * as_component(share)


def _heuristic(own: mi.Float, other: mi.Float) -> mi.Float:
    """Share of the sampling that took a direction in all that could have taken it."""
    total = own + other
    return mi.Float(dr.select(total > 0.0, own / dr.select(total > 0.0, total, 1.0), 0.0))
