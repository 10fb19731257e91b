"""Diffuse cones: the irradiance that each visible point gathers from the voxels."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.cones import RINGS, ConeSet, ratio_from_aperture, ring_cone_set
from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone
from vctgi.stages.cone_tracing.near_field import trace_near_field


@dataclass(frozen=True, kw_only=True)
class DiffuseConesConfig:
    """Which diffuse cones are traced."""

    cone_count: int = 17
    """Cones a point, one of the sets of `vctgi.maths.cones.RINGS`."""
    aperture_scale: float = 1.0
    """Factor on the apertures that cover the hemisphere once, > 0."""
    is_rotated: bool = True
    """Whether each pixel turns its cones about the normal by an angle of its own."""
    is_jittered: bool = True
    """Whether each cone takes a random share of its first step, so that no two sample the voxels
    at the same distances."""
    near_field_voxels: float = 0.0
    """Length of the real ray that replaces the beginning of a cone, in voxels, >= 0; 0: none."""
    march: ConeMarchConfig = field(default_factory=ConeMarchConfig)
    """How the cones march."""

    def __post_init__(self) -> None:
        """Refuse sets that do not exist."""
        if self.cone_count not in RINGS:
            raise ValueError(
                f"DiffuseConesConfig.cone_count must be one of {sorted(RINGS)}, "
                f"got {self.cone_count}."
            )
        if not self.aperture_scale > 0.0:
            raise ValueError(
                f"DiffuseConesConfig.aperture_scale must be > 0, got {self.aperture_scale}."
            )
        if self.near_field_voxels < 0.0:
            raise ValueError(
                f"DiffuseConesConfig.near_field_voxels must be >= 0, got {self.near_field_voxels}."
            )


def trace_diffuse(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: DiffuseConesConfig,
    scene: mi.Scene | None = None,
    sky: PrefilteredSky | None = None,
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

    Returns
    -------
    mi.Color3f
        Mean incident radiance E / pi over the cosine-weighted hemisphere, W m^-2 sr^-1; the light
        reflected to the viewer is this times the albedo.
    """
    cones = ring_cone_set(config.cone_count, config.aperture_scale)
    points = dr.width(gbuffer.position)
    block = max(1, MAX_CONES_PER_PASS // cones.cone_count)
    if points <= block:
        return _trace_block(gbuffer, volume, cones, config, scene, sky)
    gathered = dr.zeros(mi.Color3f, points)
    for begin in range(0, points, block):
        index = dr.arange(mi.UInt32, min(block, points - begin)) + begin
        part = dr.gather(GBuffer, gbuffer, index)
        dr.scatter(gathered, _trace_block(part, volume, cones, config, scene, sky), index)
        dr.eval(gathered)
    return gathered


def _trace_block(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    cones: ConeSet,
    config: DiffuseConesConfig,
    scene: mi.Scene | None,
    sky: PrefilteredSky | None,
) -> mi.Color3f:
    """Gather the light of as many points as fit one pass."""
    points = dr.width(gbuffer.position)
    # Neighbouring lanes trace the same cone of neighbouring pixels, so that they read alike.
    lane = dr.arange(mi.UInt32, points * cones.cone_count)
    point, cone = lane % points, lane // points
    sample_index = dr.gather(mi.UInt32, gbuffer.sample_index, point)
    axis_local = mi.Vector3f(
        *(dr.gather(mi.Float, mi.Float([d[i] for d in cones.directions]), cone) for i in range(3))
    )
    ratio = dr.gather(mi.Float, mi.Float([ratio_from_aperture(a) for a in cones.apertures]), cone)

    if config.is_rotated:
        sin, cos = dr.sincos(2.0 * math.pi * random_unit(sample_index, ROTATION_STREAM))
        axis_local = mi.Vector3f(
            cos * axis_local.x - sin * axis_local.y,
            sin * axis_local.x + cos * axis_local.y,
            axis_local.z,
        )
    normal = dr.gather(mi.Vector3f, gbuffer.normal, point)
    axis = mi.Frame3f(normal).to_world(axis_local)
    apex = dr.gather(mi.Point3f, gbuffer.position, point)
    is_reflecting = gbuffer.is_valid & (dr.max(gbuffer.albedo) > 0.0)
    active = dr.gather(mi.Bool, is_reflecting, point)
    jitter = random_unit(sample_index, PHASE_STREAM + cone) if config.is_jittered else 0.0
    phase = mi.Float(1.0 - jitter)
    if config.near_field_voxels > 0.0:
        assert scene is not None, "the near field traces real rays, so it needs the scene"
        near = trace_near_field(scene, volume, apex, normal, axis, config.near_field_voxels, active)
        active &= ~near.is_hit
        traced = march_cone(volume, apex, axis, ratio, phase, config.march, active, near.reach)
        radiance = dr.select(near.is_hit, near.radiance, traced.radiance)
    else:
        traced = march_cone(volume, apex, axis, ratio, phase, config.march, active)
        radiance = traced.radiance
    if sky is not None:
        # Cones that hit something nearby are not active any more: they see no sky.
        aperture = dr.gather(mi.Float, mi.Float(list(cones.apertures)), cone)
        beyond = sky.read(axis, aperture) * as_component(traced.transmittance)
        radiance += dr.select(active, beyond, 0.0)
    dr.eval(radiance)

    gathered = mi.Color3f(0.0)
    first = dr.arange(mi.UInt32, points)
    for number, weight in enumerate(cones.weights):
        gathered += weight * dr.gather(mi.Color3f, radiance, first + number * points)
    return gathered


MAX_CONES_PER_PASS = 1 << 25
"""Cones that are traced at a time; bounds the memory of a pass."""

ROTATION_STREAM, PHASE_STREAM = 100, 200
"""Hash streams of the cones' rotation and, from the second on, of each cone's phase."""
