"""Diffuse cones: the irradiance that each visible point gathers from the voxels."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.cones import GOLDEN_TURN, ConeSet, ratio_from_aperture, ring_cone_set, ring_sizes
from vctgi.maths.directions import random_unit
from vctgi.maths.peer_cones import PEER_CONE_SETS, peer_cone_set
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.stages.cone_tracing.march import ConeMarchConfig, finest_level, march_cone
from vctgi.stages.cone_tracing.near_field import trace_near_field
from vctgi.stages.cone_tracing.tally import SampleTally

Rotation = Literal["fixed", "pixel", "frame"]
"""By what angle cones are turned about the normal: none, one for each camera ray, or one for all
of a frame."""


@dataclass(frozen=True, kw_only=True)
class DiffuseConesConfig:
    """Which diffuse cones are traced."""

    cone_count: int = 17
    """Cones a point, 1 .. 64 (or 256, for studies), in rings (`vctgi.maths.cones`)."""
    cone_set: str | None = None
    """Named set of another system in place of them (`vctgi.maths.peer_cones`)."""
    aperture_scale: float = 1.0
    """Factor on the apertures that cover the hemisphere once, > 0."""
    rotation: Rotation = "pixel"
    """By what angle the cones are turned about the normal: "fixed", "pixel" or "frame". A set that
    belongs to the world is never turned."""
    frame: int = 0
    """Number of the frame, which chooses the angle of "frame", >= 0."""
    is_jittered: bool = True
    """Whether each cone takes a random share of its first step, so that no two sample the voxels
    at the same distances."""
    near_field_voxels: float = 0.0
    """Length of the real ray that replaces the beginning of a cone, in voxels, >= 0; 0: none."""
    normal_offset_voxels: float = 0.0
    """How far above the surface the cones start, in voxels, >= 0; with one-sided slots nothing is
    in their way."""
    gain: float = 1.0
    """Factor on what they gather, > 0: the scale of another system, 1 for ours."""
    march: ConeMarchConfig = field(default_factory=ConeMarchConfig)
    """How the cones march."""

    def __post_init__(self) -> None:
        """Refuse sets that do not exist."""
        ring_sizes(self.cone_count)
        if self.cone_set is not None and self.cone_set not in PEER_CONE_SETS:
            raise ValueError(
                f"DiffuseConesConfig.cone_set must be None or one of {', '.join(PEER_CONE_SETS)}, "
                f"got {self.cone_set!r}."
            )
        if self.cone_set is not None and self.cones().cone_count != self.cone_count:
            raise ValueError(
                f"DiffuseConesConfig: '{self.cone_set}' has {self.cones().cone_count} cones, but "
                f"cone_count is {self.cone_count}; give the same count, or no cone_set."
            )
        if self.rotation not in get_args(Rotation):
            raise ValueError(
                f"DiffuseConesConfig.rotation must be one of {get_args(Rotation)}, "
                f"got {self.rotation!r}."
            )
        for name in ("frame", "normal_offset_voxels"):
            if getattr(self, name) < 0:
                raise ValueError(
                    f"DiffuseConesConfig.{name} must be >= 0, got {getattr(self, name)}."
                )
        if not self.gain > 0.0:
            raise ValueError(f"DiffuseConesConfig.gain must be > 0, got {self.gain}.")
        if not self.aperture_scale > 0.0:
            raise ValueError(
                f"DiffuseConesConfig.aperture_scale must be > 0, got {self.aperture_scale}."
            )
        widest = max(self.cones().apertures)
        if not widest < math.pi:
            raise ValueError(
                f"DiffuseConesConfig.aperture_scale {self.aperture_scale:g} gives a cone an "
                f"aperture of {math.degrees(widest):.0f} degrees: lower it, they must stay "
                "below 180."
            )
        if self.near_field_voxels < 0.0:
            raise ValueError(
                f"DiffuseConesConfig.near_field_voxels must be >= 0, got {self.near_field_voxels}."
            )

    def cones(self) -> ConeSet:
        """Return the set that is traced."""
        if self.cone_set is not None:
            return peer_cone_set(self.cone_set, self.aperture_scale)
        return ring_cone_set(self.cone_count, self.aperture_scale)


def trace_diffuse(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: DiffuseConesConfig,
    scene: mi.Scene | None = None,
    sky: PrefilteredSky | None = None,
    tally: SampleTally | None = None,
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

    Returns
    -------
    mi.Color3f
        Mean incident radiance E / pi over the cosine-weighted hemisphere, W m^-2 sr^-1; the light
        reflected to the viewer is this times the albedo.
    """
    cones = config.cones()
    points = dr.width(gbuffer.position)
    block = max(1, MAX_CONES_PER_PASS // cones.cone_count)
    if points <= block:
        return _trace_block(gbuffer, volume, cones, config, scene, sky, tally)
    gathered = dr.zeros(mi.Color3f, points)
    for begin in range(0, points, block):
        index = dr.arange(mi.UInt32, min(block, points - begin)) + begin
        part = dr.gather(GBuffer, gbuffer, index)
        light = _trace_block(part, volume, cones, config, scene, sky, tally)
        dr.scatter(gathered, light, index)
        dr.eval(gathered)
    return gathered


def _trace_block(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    cones: ConeSet,
    config: DiffuseConesConfig,
    scene: mi.Scene | None,
    sky: PrefilteredSky | None,
    tally: SampleTally | None,
) -> mi.Color3f:
    """Gather the light of as many points as fit one pass."""
    points = dr.width(gbuffer.position)
    lanes = diffuse_lanes(gbuffer, volume, cones, config)
    point, cone, axis, normal = lanes.point, lanes.cone, lanes.axis, lanes.normal
    apex, ratio, phase, active = lanes.apex, lanes.ratio, lanes.phase, lanes.active
    if config.near_field_voxels > 0.0:
        assert scene is not None, "the near field traces real rays, so it needs the scene"
        near = trace_near_field(scene, volume, apex, normal, axis, config.near_field_voxels, active)
        if tally is not None:
            tally.add_rays(active, dr.width(point))
        active = active & ~near.is_hit
        traced = march_cone(volume, apex, axis, ratio, phase, config.march, active, near.reach)
        radiance = dr.select(near.is_hit, near.radiance, traced.radiance)
    else:
        traced = march_cone(volume, apex, axis, ratio, phase, config.march, active)
        radiance = traced.radiance
    if tally is not None:
        tally.add(traced, active)
    if sky is not None:
        # Cones that hit something nearby are not active any more: they see no sky.
        aperture = dr.gather(mi.Float, mi.Float(list(cones.apertures)), cone)
        beyond = sky.read(axis, aperture) * as_component(traced.transmittance)
        radiance += dr.select(active, beyond, 0.0)
    if cones.frame == "world":
        radiance *= as_component(_cosine_shares(axis, normal, cones, gbuffer, point))
    dr.eval(radiance)

    gathered = mi.Color3f(0.0)
    first = dr.arange(mi.UInt32, points)
    for number, weight in enumerate(cones.weights):
        share = config.gain * (1.0 if cones.frame == "world" else weight)
        gathered += share * dr.gather(mi.Color3f, radiance, first + number * points)
    return gathered


@dataclass
class DiffuseLanes:
    """Diffuse cones, one a lane: all points' first cone, then all points' second one, and so on.

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
    """

    point: mi.UInt32
    cone: mi.UInt32
    apex: mi.Point3f
    normal: mi.Vector3f
    axis: mi.Vector3f
    ratio: mi.Float
    phase: mi.Float
    active: mi.Bool


def diffuse_lanes(
    gbuffer: GBuffer, volume: VoxelVolume, cones: ConeSet, config: DiffuseConesConfig
) -> DiffuseLanes:
    """Return the cones of all points."""
    points = dr.width(gbuffer.position)
    # Neighbouring lanes trace the same cone of neighbouring pixels, so that they read alike.
    lane = dr.arange(mi.UInt32, points * cones.cone_count)
    point, cone = lane % points, lane // points
    sample_index = dr.gather(mi.UInt32, gbuffer.sample_index, point)
    axis_local = mi.Vector3f(
        *(dr.gather(mi.Float, mi.Float([d[i] for d in cones.directions]), cone) for i in range(3))
    )
    ratio = dr.gather(mi.Float, mi.Float([ratio_from_aperture(a) for a in cones.apertures]), cone)

    normal = dr.gather(mi.Vector3f, gbuffer.normal, point)
    axis = _world_axes(axis_local, normal, sample_index, cones, config)
    apex = dr.gather(mi.Point3f, gbuffer.position, point)
    is_reflecting = gbuffer.is_valid & (dr.max(gbuffer.albedo) > 0.0)
    active = dr.gather(mi.Bool, is_reflecting, point)
    if cones.frame == "world":
        active &= dr.dot(axis, normal) > 0.0
    jitter = random_unit(sample_index, PHASE_STREAM + cone) if config.is_jittered else 0.0
    phase = mi.Float(1.0 - jitter)
    if config.normal_offset_voxels > 0.0:
        apex = _above(volume, apex, normal, config.normal_offset_voxels)
    return DiffuseLanes(point, cone, apex, normal, axis, ratio, phase, active)


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
    layout = volume.layout
    distance = voxels * layout.finest_voxel_size * dr.exp2(finest_level(layout, apex))
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


MAX_CONES_PER_PASS = 1 << 25
"""Cones that are traced at a time; bounds the memory of a pass."""

ROTATION_STREAM, PHASE_STREAM = 100, 200
"""Hash streams of the cones' rotation and, from the second on, of each cone's phase."""
