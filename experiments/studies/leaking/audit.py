"""The leak audit of diffuse cones: what of their light came through geometry, and what is true.

Each cone is marched as the renderer marches it. Beside it go probe rays: its axis and a bundle that
fills it, each a Mitsuba ray from the apex. They say how far the cone truly reaches, and what light
leaves the surfaces that it truly meets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from metrics.leaking import LeakAudit
from vctgi.clipmap.storage import VoxelVolume
from vctgi.debug.leak_march import Cones, LeakSample, Probes, march_with_probes
from vctgi.maths.directions import offset_from_surface, random_unit
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import half_extent
from vctgi.scene.records import GBuffer
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, DiffuseLanes, diffuse_lanes
from vctgi.stages.cone_tracing.lane_order import cone_after_cone
from vctgi.stages.cone_tracing.near_field import trace_near_field

PROBE_COUNT = 8
"""Probes of a cone beside its axis."""

LIGHT_SAMPLES = 2
"""Light samples where a probe lands."""

NEAR_BEHIND = 1e-3
"""Share of a distance by which a shadow ray ends before it."""

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


class Leaving(Protocol):
    """What leaves surfaces towards rays."""

    def __call__(self, si: mi.SurfaceInteraction3f, lane: mi.UInt32, seed: int) -> mi.Color3f:
        """Return the radiance of the surfaces that rays met; lanes and seed are for hashes."""


@dataclass(frozen=True, kw_only=True)
class PointLight:
    """Luminance of the light at each point, of one batch of probes, ``[point]``.

    Attributes
    ----------
    gathered
        What its cones bring.
    through, hidden, blocked
        Parts of it, as `vctgi.debug.leak_march.LeakSample` has them.
    truth
        What they should bring: mean over the probes.
    cone_light, is_blocked
        ``[cone, point]``: what each cone brings, and whether its chosen place cannot be seen.
    """

    gathered: np.ndarray
    through: np.ndarray
    hidden: np.ndarray
    blocked: np.ndarray
    truth: np.ndarray
    cone_light: np.ndarray
    is_blocked: np.ndarray


def audit_points(
    scene: mi.Scene,
    volume: VoxelVolume,
    gbuffer: GBuffer,
    config: DiffuseConesConfig,
    leaving: Leaving,
    seed: int,
) -> PointLight:
    """Audit the diffuse cones of visible points.

    Parameters
    ----------
    scene
        Geometry.
    volume
        Lit voxels.
    gbuffer
        Visible points.
    config
        The cones that are audited, of a set in the frame of the surface.
    leaving
        True radiance of the surfaces, of as many scatterings as the voxels hold.
    seed
        Chooses probes and steps; other seeds give independent batches.

    Raises
    ------
    ValueError
        Cones in the frame of the world, or of texels by chance.
    """
    cones = config.cones()
    if cones.frame != "tangent":
        raise ValueError(
            "audit_points: DiffuseConesConfig.cone_set must be in the frame of the surface."
        )
    if config.march.filtering != "linear":
        raise ValueError(
            "audit_points: ConeMarchConfig.filtering chooses texels, and the audit follows all "
            'that are interpolated; set it to "linear".'
        )
    table = cone_after_cone(dr.width(gbuffer.position), cones.cone_count)
    lanes = diffuse_lanes(gbuffer, volume, cones, config, table)
    active, reach = lanes.active, dr.zeros(mi.Float, dr.width(lanes.ratio))
    near_light = dr.zeros(mi.Color3f, dr.width(lanes.ratio))
    if config.near_field_voxels > 0.0:
        near = trace_near_field(
            scene,
            volume,
            lanes.apex,
            lanes.normal,
            lanes.axis,
            config.near_field_voxels,
            active,
        )
        # A new array: the probes of the others are wanted too.
        active = lanes.active & ~near.is_hit
        near_light, reach = near.radiance, near.reach
    found = _trace_probes(scene, lanes, reach, leaving, seed)
    marched = march_with_probes(
        volume,
        Cones(lanes.apex, lanes.axis, lanes.ratio, lanes.phase, reach),
        Probes(found.distance, found.share),
        config.march,
        active,
        seed,
    )
    is_blocked = _is_chosen_blocked(scene, lanes, found, marched, seed)
    radiance = mi.Color3f(marched.radiance + near_light)
    shape = (cones.cone_count, dr.width(gbuffer.position))
    weights = config.gain * np.array(cones.weights)[:, None]

    def at_points(light: mi.Color3f) -> np.ndarray:
        bright = np.array(mi.luminance(light), dtype=np.float64).reshape(shape)
        summed: np.ndarray = (weights * bright).sum(axis=0)
        return summed

    light = weights * np.array(mi.luminance(radiance), dtype=np.float64).reshape(shape)
    return PointLight(
        gathered=light.sum(axis=0),
        through=at_points(marched.through),
        hidden=at_points(marched.hidden),
        blocked=at_points(marched.blocked),
        # A gain is part of the method, and no part of the truth.
        truth=at_points(found.radiance) / config.gain,
        cone_light=light,
        is_blocked=np.array(is_blocked & active).reshape(shape),
    )


def audit_of(batches: list[PointLight], shape: tuple[int, int]) -> LeakAudit:
    """Return the audit of a picture from batches whose points are its pixels."""
    return LeakAudit(
        gathered=np.stack([each.gathered.reshape(shape) for each in batches]),
        through=np.stack([each.through.reshape(shape) for each in batches]),
        truth=np.stack([each.truth.reshape(shape) for each in batches]),
    )


@dataclass
class _Found:
    """Probes of each cone: direction, distance along the axis, share; mean radiance they see."""

    direction: list[mi.Vector3f]
    distance: list[mi.Float]
    share: list[mi.Float]
    radiance: mi.Color3f


def _trace_probes(
    scene: mi.Scene, lanes: DiffuseLanes, near: mi.Float, leaving: Leaving, seed: int
) -> _Found:
    """Trace the axis and a bundle of rays that fills each cone.

    Probes below the surface do not count, nor do those that end before the march begins: there a
    real ray along the axis has decided for the whole cone.
    """
    width = dr.width(lanes.ratio)
    lane = dr.arange(mi.UInt32, width)
    stream = _stream(seed)
    turn, shift = (random_unit(lane, stream + number) for number in range(2))
    cosine_rim = dr.rsqrt(1.0 + dr.square(0.5 * lanes.ratio))
    frame = mi.Frame3f(lanes.axis)
    start = offset_from_surface(lanes.apex, lanes.normal, half_extent(scene))
    found = _Found([], [], [], dr.zeros(mi.Color3f, width))
    total, seen_total = dr.zeros(mi.Float, width), dr.zeros(mi.Float, width)
    for number in range(PROBE_COUNT + 1):
        # Opaque, so that all probes share one kernel.
        place = dr.opaque(mi.Float, number - 1.0)
        depth = dr.maximum((place + shift) / PROBE_COUNT, 0.0) * (1.0 - cosine_rim)
        cosine = dr.select(place < 0.0, 1.0, 1.0 - depth)
        sine = dr.safe_sqrt(1.0 - dr.square(cosine))
        sin, cos = dr.sincos(GOLDEN_ANGLE * place + 2.0 * math.pi * turn)
        direction = mi.Vector3f(frame.to_world(mi.Vector3f(sine * cos, sine * sin, cosine)))
        si = scene.ray_intersect(mi.Ray3f(start, direction), as_mask(lanes.active))
        is_above = dr.dot(direction, lanes.normal) > 0.0
        distance = dr.select(si.is_valid(), mi.Float(si.t) * cosine, dr.inf)
        # The axis always counts, so that every cone has a probe.
        counts = (is_above & (distance >= near)) | (place < 0.0)
        share = dr.select(counts, mi.Float(1.0), 0.0)
        light = leaving(si, lane * (PROBE_COUNT + 1) + number, seed)
        # Of what the cone should see the axis is no fair sample, and what is near is a part.
        is_sample = is_above & (place >= 0.0) & lanes.active
        found.radiance += dr.select(is_sample, light, 0.0)
        seen_total += dr.select(is_sample, mi.Float(1.0), 0.0)
        total += share
        dr.eval(direction, distance, share, found.radiance, seen_total, total)
        found.direction.append(direction)
        found.distance.append(distance)
        found.share.append(share)
    found.share = [mi.Float(share / total) for share in found.share]
    found.radiance = mi.Color3f(found.radiance / as_component(dr.maximum(seen_total, 1.0)))
    return found


def _is_chosen_blocked(
    scene: mi.Scene, lanes: DiffuseLanes, found: _Found, marched: LeakSample, seed: int
) -> mi.Bool:
    """Whether a shadow ray, along one of the probes, does not reach each cone's chosen place."""
    u = random_unit(dr.arange(mi.UInt32, dr.width(lanes.ratio)), _stream(seed) + 2)
    direction = mi.Vector3f(found.direction[0])
    below = mi.Float(0.0)
    for each, share in zip(found.direction, found.share, strict=True):
        direction = dr.select((u >= below) & (share > 0.0), each, direction)
        below += share
    cosine = dr.maximum(mi.Float(dr.dot(mi.Vector3f(direction), lanes.axis)), NEAR_BEHIND)
    start = offset_from_surface(lanes.apex, lanes.normal, half_extent(scene))
    ray = mi.Ray3f(start, direction)
    length = (marched.chosen_t - marched.chosen_reach) / cosine
    ray.maxt = as_component(length * (1.0 - NEAR_BEHIND))
    return mi.Bool(scene.ray_test(ray, as_mask(length > 0.0)))


def _stream(seed: int) -> mi.UInt32:
    """Return the first hash stream of a batch; opaque, so that all batches share their kernels."""
    return dr.opaque(mi.UInt32, PROBE_STREAM + 16 * seed)


def reflected_light(scene: mi.Scene) -> Leaving:
    """Return what diffuse surfaces of a scene send out after one scattering."""

    def leaving(si: mi.SurfaceInteraction3f, lane: mi.UInt32, seed: int) -> mi.Color3f:
        total = dr.zeros(mi.Color3f, dr.width(lane))
        for number in range(LIGHT_SAMPLES):
            stream = LIGHT_STREAM + 64 * seed + 2 * number
            u, v = (random_unit(lane, dr.opaque(mi.UInt32, stream + i)) for i in range(2))
            found, weight = scene.sample_emitter_direction(
                si, mi.Point2f(u, v), True, si.is_valid()
            )
            value = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(found.d), si.is_valid())
            total += dr.select(si.is_valid(), mi.Color3f(value * weight), 0.0)
        return mi.Color3f(total / LIGHT_SAMPLES)

    return leaving


PROBE_STREAM, LIGHT_STREAM = 9000, 12000
"""First hash streams of probes and of the light where they land."""
