"""Diffuse cones: the irradiance that each visible point gathers from the voxels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.clipmap.texel_choice import TexelChoice, random_choice
from vctgi.maths.cones import GOLDEN_TURN, ConeSet, ratio_from_aperture, ring_rims
from vctgi.maths.constant_tables import float_table
from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.stages.cone_tracing.cone_values import ConeValues
from vctgi.stages.cone_tracing.diffuse_config import DiffuseConesConfig as DiffuseConesConfig
from vctgi.stages.cone_tracing.diffuse_config import Rotation as Rotation
from vctgi.stages.cone_tracing.lane_order import LaneOrder
from vctgi.stages.cone_tracing.march import finest_level, march_cone
from vctgi.stages.cone_tracing.near_field import trace_near_field
from vctgi.stages.cone_tracing.passes import trace_in_passes
from vctgi.stages.cone_tracing.tally import SampleTally


def trace_diffuse(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: DiffuseConesConfig,
    scene: mi.Scene | None = None,
    sky: PrefilteredSky | None = None,
    tally: SampleTally | None = None,
    parameters: ConeValues | None = None,
) -> mi.Color3f:
    """Gather indirect diffuse light.

    Parameters
    ----------
    gbuffer
        Visible points.
    volume
        Lit voxels.
    config
        Cone set and march.
    scene
        Geometry, which only the near field needs.
    sky
        What the share of a cone sees that nothing stops; None: darkness.
    tally
        Counts what the cones read; None: nothing is counted.
    parameters
        Values that go before the numbers of `config`, for derivatives; None: those numbers.

    Returns
    -------
    mi.Color3f
        Mean incident radiance E / pi over the cosine-weighted hemisphere, W m^-2 sr^-1; the light
        reflected to the viewer is this times the albedo.
    """
    cones = config.cones()

    def trace(part: GBuffer) -> mi.Color3f:
        return _trace_pass(part, volume, cones, config, scene, sky, tally, parameters)

    return trace_in_passes(gbuffer, cones.cone_count, trace)


def _trace_pass(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    cones: ConeSet,
    config: DiffuseConesConfig,
    scene: mi.Scene | None,
    sky: PrefilteredSky | None,
    tally: SampleTally | None,
    parameters: ConeValues | None,
) -> mi.Color3f:
    """Gather the light of as many points as fit one pass."""
    points = dr.width(gbuffer.position)
    order = LaneOrder.of(cones.cone_count, config.near_field_voxels)
    lanes = diffuse_lanes(gbuffer, volume, cones, config, order, parameters)
    point, cone, axis, normal = lanes.point, lanes.cone, lanes.axis, lanes.normal
    apex, ratio, phase, active = lanes.apex, lanes.ratio, lanes.phase, lanes.active
    march = config.march if parameters is None else parameters.march(config.march, cone)
    chosen = volume.choosing(lanes.choice)
    if config.near_field_voxels > 0.0:
        assert scene is not None, "the near field traces real rays, so it needs the scene"
        near = trace_near_field(scene, volume, apex, normal, axis, config.near_field_voxels, active)
        if tally is not None:
            tally.add_rays(active, dr.width(point))
        active = active & ~near.is_hit
        traced = march_cone(chosen, apex, axis, ratio, phase, march, active, near.reach)
        radiance = dr.select(near.is_hit, near.radiance, traced.radiance)
    else:
        traced = march_cone(chosen, apex, axis, ratio, phase, march, active)
        radiance = traced.radiance
    if tally is not None:
        tally.add(traced, active)
    if sky is not None:
        # Cones that hit something nearby are not active any more: they see no sky.
        if parameters is None:
            aperture = dr.gather(mi.Float, float_table(tuple(cones.apertures)), cone)
        else:
            aperture = parameters.lane_apertures(cone)
        beyond = sky.read(axis, aperture) * as_component(traced.transmittance)
        radiance += dr.select(active, beyond, 0.0)
    if cones.frame == "world":
        radiance *= as_component(_cosine_shares(axis, normal, cones, gbuffer, point))
    dr.eval(radiance)

    gathered = mi.Color3f(0.0)
    place = dr.arange(mi.UInt32, points)
    weights: list[float | mi.Float] = list(cones.weights)
    if parameters is not None:
        shares = parameters.normalised_weights()
        weights = [dr.gather(mi.Float, shares, mi.UInt32(k)) for k in range(cones.cone_count)]
    for number, weight in enumerate(weights):
        share = as_component(config.gain * (1.0 if cones.frame == "world" else weight))
        gathered += share * dr.gather(mi.Color3f, radiance, order.lane_of(place, number))
    return gathered


@dataclass
class DiffuseLanes:
    """Diffuse cones, one a lane.

    Attributes
    ----------
    point, cone
        Which point a lane belongs to, and which cone of the set it is.
    apex, normal, axis
        Where it starts, the surface's normal there, its unit direction.
    ratio
        Footprint over distance.
    phase
        Share of the first step that it takes, (0, 1].
    active
        Whether it is traced.
    choice
        What chooses its texels; None: they are interpolated.
    """

    point: mi.UInt32
    cone: mi.UInt32
    apex: mi.Point3f
    normal: mi.Vector3f
    axis: mi.Vector3f
    ratio: mi.Float
    phase: mi.Float
    active: mi.Bool
    choice: TexelChoice | None


def diffuse_lanes(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    cones: ConeSet,
    config: DiffuseConesConfig,
    order: LaneOrder,
    parameters: ConeValues | None = None,
) -> DiffuseLanes:
    """Return the cones of all points."""
    lanes = order.deal(dr.width(gbuffer.position))
    point, cone = lanes.point, lanes.cone
    sample_index = dr.gather(mi.UInt32, gbuffer.sample_index, point)
    if parameters is None:
        axes = (tuple(d[i] for d in cones.directions) for i in range(3))
        axis_local = mi.Vector3f(*(dr.gather(mi.Float, float_table(each), cone) for each in axes))
        ratios = float_table(tuple(ratio_from_aperture(a) for a in cones.apertures))
        ratio = dr.gather(mi.Float, ratios, cone)
    else:
        axis_local = parameters.local_axis(cone)
        ratio = mi.Float(2.0 * dr.tan(0.5 * parameters.lane_apertures(cone)))

    if config.ring_jitter > 0.0:
        axis_local = _within_rings(axis_local, cone, sample_index, config)
    normal = dr.gather(mi.Vector3f, gbuffer.normal, point)
    axis = _world_axes(axis_local, normal, sample_index, cones, config)
    apex = dr.gather(mi.Point3f, gbuffer.position, point)
    is_reflecting = gbuffer.is_valid & (dr.max(gbuffer.albedo) > 0.0)
    active = lanes.is_used & dr.gather(mi.Bool, is_reflecting, point)
    if cones.frame == "world":
        active &= dr.dot(axis, normal) > 0.0
    jitter = random_unit(sample_index, PHASE_STREAM + cone) if config.is_jittered else 0.0
    phase = mi.Float(1.0 - jitter)
    if config.normal_offset_voxels > 0.0:
        apex = _above(volume, apex, normal, config.normal_offset_voxels)
    choice = random_choice(sample_index, cone, config.march.filtering)
    return DiffuseLanes(point, cone, apex, normal, axis, ratio, phase, active, choice)


def _within_rings(
    axis_local: mi.Vector3f, cone: mi.UInt32, sample_index: mi.UInt32, config: DiffuseConesConfig
) -> mi.Vector3f:
    """Return axes moved at random towards the rims of their rings, evenly by the cosine.

    At a jitter of 1 the axes of many samples fill the cosine-weighted hemisphere evenly, so what
    few elevations see wrong is noise and no error of the mean.
    """
    rims = ring_rims(config.cone_count)
    low, high = (dr.gather(mi.Float, float_table(each), cone) for each in zip(*rims, strict=True))
    held = mi.Float(dr.square(axis_local.x) + dr.square(axis_local.y))
    # The cones of a ring share it out among them, so that each point sees nearly all elevations.
    turn = random_unit(sample_index, RING_STREAM) + GOLDEN_TURN * mi.Float(cone)
    place = dr.lerp(low, high, turn - dr.floor(turn))
    moved = dr.lerp(held, place, dr.opaque(mi.Float, config.ring_jitter))
    # The pole has no azimuth: any will do, as all are turned with the pixel.
    is_pole = held < LEAST_SQUARE
    stretch = dr.sqrt(moved / dr.select(is_pole, 1.0, held))
    return mi.Vector3f(
        dr.select(is_pole, dr.sqrt(moved), axis_local.x * stretch),
        dr.select(is_pole, 0.0, axis_local.y * stretch),
        dr.safe_sqrt(1.0 - moved),
    )


def _world_axes(
    axis_local: mi.Vector3f,
    normal: mi.Vector3f,
    sample_index: mi.UInt32,
    cones: ConeSet,
    config: DiffuseConesConfig,
) -> mi.Vector3f:
    """Return the axes of cones in the world, turned about the normal as the config says."""
    if cones.frame == "world":
        return axis_local
    if config.rotation != "fixed":
        if config.rotation == "pixel":
            turns = random_unit(sample_index, ROTATION_STREAM)
        else:
            # Opaque, so that all frames share one kernel.
            turns = dr.opaque(mi.Float, config.frame * GOLDEN_TURN % 1.0)
        sin, cos = dr.sincos(2.0 * math.pi * turns)
        axis_local = mi.Vector3f(
            cos * axis_local.x - sin * axis_local.y,
            sin * axis_local.x + cos * axis_local.y,
            axis_local.z,
        )
    return mi.Vector3f(mi.Frame3f(normal).to_world(axis_local))


def _above(volume: VoxelVolume, apex: mi.Point3f, normal: mi.Vector3f, voxels: float) -> mi.Point3f:
    """Return points lifted off their surface, by voxels of the finest level that holds them."""
    distance = voxels * volume.layout.finest_voxel_size * dr.exp2(finest_level(volume, apex))
    return mi.Point3f(dr.fma(normal, as_component(distance), apex))


def _cosine_shares(
    axis: mi.Vector3f, normal: mi.Vector3f, cones: ConeSet, gbuffer: GBuffer, point: mi.UInt32
) -> mi.Float:
    """Cosine of each cone to the normal, over the sum for its point."""
    total = mi.Float(0.0)
    for direction in cones.directions:
        above = mi.Float(dr.dot(mi.Vector3f(*direction), gbuffer.normal))
        total += dr.maximum(above, 0.0)
    cosine = mi.Float(dr.dot(axis, normal))
    # Points that are no surface have no normal, and no cone above it.
    total = dr.select(total > 0.0, total, 1.0)
    return dr.maximum(cosine, 0.0) / dr.gather(mi.Float, total, point)


ROTATION_STREAM, PHASE_STREAM, RING_STREAM = 100, 200, 600
"""Hash streams of the cones' rotation, of each cone's phase from there on, and of their places in
their rings."""

LEAST_SQUARE = 1e-8
"""Squared sine of an elevation below which an axis is the pole's."""
