"""What visible points gather when some stages are exact: one function of which ones.

Nothing exact is the renderer's own `trace_diffuse`. Otherwise each point sends rays for every cone
and sums what they see; with exact visibility and radiance that is a path tracer, which knows
nothing of voxels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from experiments.studies.attribution.radiance import scattered_radiance
from experiments.studies.attribution.stages import Exact
from vctgi.clipmap.sampling import read_surface
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.cones import ConeSet, ratio_from_aperture, ring_cone_set
from vctgi.maths.directions import (
    face_forward,
    kronecker_points,
    offset_from_surface,
    random_unit,
)
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import half_extent
from vctgi.scene.records import GBuffer
from vctgi.stages.cone_tracing.diffuse import (
    PHASE_STREAM,
    ROTATION_STREAM,
    DiffuseConesConfig,
    trace_diffuse,
)
from vctgi.stages.cone_tracing.march import finest_level, march_cone
from vctgi.stages.cone_tracing.near_field import trace_near_field

PLACE_STREAM = 1300
"""First hash stream of directions within cones and over the hemisphere."""

STREAMS_PER_REPEAT = 1024
"""Hash streams that the directions of a repeat may use."""

MAX_REPEATS = 64
"""Repeats that one seed may use before it meets the next seed's."""

HAIR = 1e-3
"""Share of a cone's ratio that a hair-thin ray has: all samples are read from the finest level."""

HAIR_STEP_VOXELS = 0.5
"""Shortest step of such a ray, as in the study "representation"."""


@dataclass(frozen=True)
class Gatherer:
    """Gathers E / pi [point] of visible points with some stages exact.

    Attributes
    ----------
    scene, volume
        Geometry, and its lit voxels.
    cones
        Of the renderer as it is; rings without gain or offset.
    scattering_count
        Most scatterings between emitter and the surface that a ray meets.
    exact
        Which stages are exact; `light`, `storage` and `pixels` are not this module's.
    repeat_count
        Rays a cone, 1 .. `MAX_REPEATS`.
    """

    scene: mi.Scene
    volume: VoxelVolume
    cones: DiffuseConesConfig
    scattering_count: int
    exact: Exact
    repeat_count: int = 1

    def __post_init__(self) -> None:
        """Refuse cones whose solid angles are not known."""
        cones = self.cones
        known = cones.cone_set is None and cones.normal_offset_voxels == 0.0
        if not known or cones.gain != 1.0 or cones.ring_jitter != 0.0:
            raise ValueError(
                "Gatherer: only ring sets without gain, normal offset and jitter can be "
                "attributed; leave cone_set, gain, normal_offset_voxels and ring_jitter at their "
                "defaults."
            )

    def __call__(self, gbuffer: GBuffer, seed: int) -> mi.Color3f:
        """Return E / pi at visible points; 0 where nothing reflects.

        The seed is that of paths; directions hash the points' own numbers.
        """
        exact, points = self.exact, dr.width(gbuffer.position)
        total = dr.zeros(mi.Color3f, points)
        has_own_cones = not (exact.width or exact.directions or exact.visibility)
        if has_own_cones:
            total += trace_diffuse(gbuffer, self.volume, self.cones, self.scene)
            if not exact.radiance:
                return total
        cones = ring_cone_set(self.cones.cone_count, self.cones.aperture_scale)
        first = dr.arange(mi.UInt32, points)
        for repeat in range(self.repeat_count):
            rays = _spread(gbuffer, cones, exact, repeat)
            seen = self._see(rays, seed * MAX_REPEATS + repeat, has_march=not has_own_cones)
            for number in range(cones.cone_count):
                share = dr.gather(mi.Color3f, seen, first + number * points)
                total += share / (cones.cone_count * self.repeat_count)
            dr.eval(total)
        return total

    def _see(self, rays: _Rays, seed: int, *, has_march: bool) -> mi.Color3f:
        """Radiance along rays; without the march only what exact radiance adds to it."""
        exact = self.exact
        seen = dr.zeros(mi.Color3f, dr.width(rays.ratio))
        if has_march and not exact.visibility:
            seen += self._march(rays)
        if exact.visibility != exact.radiance:
            voxel = self._voxel_of_hit(rays)
            seen = seen + voxel if exact.visibility else seen - voxel
        if exact.radiance:
            real = self._real(rays)
            seen += scattered_radiance(self.scene, real, self.scattering_count, seed, rays.active)
        dr.eval(seen)
        return seen

    def _march(self, rays: _Rays) -> mi.Color3f:
        """Radiance by voxels, as the renderer sees it: near field, then march."""
        ratio, march = rays.ratio, self.cones.march
        if self.exact.width:
            ratio = rays.ratio * HAIR
            march = replace(march, min_step_voxels=max(march.min_step_voxels, HAIR_STEP_VOXELS))
        phase = mi.Float(1.0 - rays.jitter) if self.cones.is_jittered else mi.Float(1.0)
        apex, axis, active = rays.apex, rays.axis, rays.active
        # What random texels are in the mean.
        march = replace(march, filtering="linear")
        reach = self.cones.near_field_voxels
        if reach == 0.0:
            return march_cone(self.volume, apex, axis, ratio, phase, march, active).radiance
        near = trace_near_field(self.scene, self.volume, apex, rays.normal, axis, reach, active)
        active &= ~near.is_hit
        far = march_cone(self.volume, apex, axis, ratio, phase, march, active, near.reach)
        return mi.Color3f(dr.select(near.is_hit, near.radiance, far.radiance))

    def _real(self, rays: _Rays) -> mi.Ray3f:
        start = offset_from_surface(rays.apex, rays.normal, half_extent(self.scene))
        return mi.Ray3f(start, rays.axis)

    def _voxel_of_hit(self, rays: _Rays) -> mi.Color3f:
        """Radiance of the voxel of the first surface; of a cone's level if it has its width."""
        si = self.scene.ray_intersect(self._real(rays), as_mask(rays.active))
        is_hit = mi.Bool(si.is_valid())
        layout = self.volume.layout
        held = mi.Float(dr.ceil(finest_level(self.volume, si.p)))
        if not self.exact.width:
            footprint = rays.ratio * mi.Float(si.t) / layout.finest_voxel_size
            wanted = dr.round(dr.log2(footprint) + self.cones.march.level_bias)
            last = float(len(layout.levels) - 1)
            held = mi.Float(dr.clip(dr.maximum(held, wanted), 0.0, last))
        facing = face_forward(mi.Vector3f(si.n), -rays.axis)
        level = mi.UInt32(dr.select(is_hit, held, 0.0))
        radiance, _opacity = read_surface(self.volume, level, si.p, facing, is_hit)
        return mi.Color3f(dr.select(is_hit, radiance, 0.0))


@dataclass
class _Rays:
    """A ray for every cone of every point, the lanes of one cone side by side.

    Attributes
    ----------
    apex, normal
        Of the surface.
    axis
        A direction of the cone's solid angle.
    ratio
        Of the cone.
    jitter
        Random number in [0, 1) for the first step.
    active
        Whether the point reflects.
    """

    apex: mi.Point3f
    normal: mi.Vector3f
    axis: mi.Vector3f
    ratio: mi.Float
    jitter: mi.Float
    active: mi.Bool


def _spread(gbuffer: GBuffer, cones: ConeSet, exact: Exact, repeat: int) -> _Rays:
    points, count = dr.width(gbuffer.position), cones.cone_count
    lane = dr.arange(mi.UInt32, points * count)
    point, cone = lane % points, lane // points
    sample_index = dr.gather(mi.UInt32, gbuffer.sample_index, point)
    normal = dr.gather(mi.Vector3f, gbuffer.normal, point)
    # Opaque, so that all repeats share one kernel.
    stream = dr.opaque(mi.UInt32, PLACE_STREAM + STREAMS_PER_REPEAT * repeat)
    if exact.directions:
        shift = mi.Point2f(random_unit(sample_index, stream), random_unit(sample_index, stream + 1))
        place = kronecker_points(cone) + shift
        local = mi.Vector3f(mi.warp.square_to_cosine_hemisphere(place - dr.floor(place)))
        ratio = _ratio_of(mi.Float(local.z), cones)
    else:
        axis, ratio, cosine = _axes(cones, cone, sample_index)
        own = stream + 2 + 2 * cone
        place = mi.Point2f(random_unit(sample_index, own), random_unit(sample_index, own + 1))
        within = mi.warp.square_to_uniform_cone(place, as_component(cosine))
        local = mi.Vector3f(mi.Frame3f(axis).to_world(within))
        # What lies below the horizon of the surface is seen by nobody.
        local.z = dr.abs(local.z)
    is_reflecting = gbuffer.is_valid & (dr.max(gbuffer.albedo) > 0.0)
    return _Rays(
        apex=dr.gather(mi.Point3f, gbuffer.position, point),
        normal=normal,
        axis=mi.Vector3f(mi.Frame3f(normal).to_world(local)),
        ratio=ratio,
        jitter=random_unit(sample_index, PHASE_STREAM + cone),
        active=dr.gather(mi.Bool, is_reflecting, point),
    )


def _axes(
    cones: ConeSet, cone: mi.UInt32, sample_index: mi.UInt32
) -> tuple[mi.Vector3f, mi.Float, mi.Float]:
    """Axes of a set around z, turned as the renderer does; ratios, cosines of half apertures."""
    local = mi.Vector3f(
        *(dr.gather(mi.Float, mi.Float([d[i] for d in cones.directions]), cone) for i in range(3))
    )
    cosines = mi.Float([math.cos(0.5 * aperture) for aperture in cones.apertures])
    ratios = mi.Float([ratio_from_aperture(aperture) for aperture in cones.apertures])
    sin, cos = dr.sincos(2.0 * math.pi * random_unit(sample_index, ROTATION_STREAM))
    axis = mi.Vector3f(cos * local.x - sin * local.y, sin * local.x + cos * local.y, local.z)
    return axis, dr.gather(mi.Float, ratios, cone), dr.gather(mi.Float, cosines, cone)


def _ratio_of(cosine: mi.Float, cones: ConeSet) -> mi.Float:
    """Ratio of a cone of the set's weight at any angle; none is wider than the set's widest.

    A cone of weight 1 / n at the cosine c has the solid angle pi / (n c).
    """
    lowest = min(direction[2] for direction in cones.directions)
    solid_angle = math.pi / (cones.cone_count * dr.maximum(cosine, lowest))
    half = dr.acos(1.0 - solid_angle * (0.5 / math.pi))
    return mi.Float(2.0 * as_component(dr.tan(half)))
