"""The G-buffer: what camera rays meet first, and which lobes it reflects with.

Lobes are measured on the BSDF itself by sampling it, which works for every BSDF that Mitsuba has.
A sample's weight holds the light of all lobes, so it is shared out by their values at the sampled
direction. The diffuse shares make the diffuse albedo; of the others the mean direction gives the
axis of a cone, and the length of that mean its aperture (moment matching,
`vctgi.maths.cones.aperture_from_mean_cosine`).

For isotropic GGX and Beckmann lobes of known roughness a cone without noise stands in a table, and
the lobe's long tail does not widen it (`vctgi.maths.lobes`). An anisotropic lobe is measured, and
approximated by one round cone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi

from vctgi.maths.cones import aperture_from_mean_cosine
from vctgi.maths.directions import face_forward, kronecker_points, random_unit
from vctgi.maths.lobes import TABLES, read_lobe_cone
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.forward_mode import ready_for_forward_mode
from vctgi.scene.records import GBuffer
from vctgi.scene.registry import read_by_number

LobeCones = Literal["sampled", "fitted"]
"""Where cones of lobes come from: samples of the BSDF, or its table where it has one."""


@dataclass(frozen=True, kw_only=True)
class GBufferConfig:
    """How lobes are measured."""

    lobe_sample_count: int = 16
    """BSDF samples for each point of a surface that is not plainly diffuse, >= 1."""
    lobe_cones: LobeCones = "fitted"
    """ "sampled", or "fitted": isotropic GGX and Beckmann lobes of rough conductors and plastics
    take their cone from a table; the others are sampled all the same."""

    def __post_init__(self) -> None:
        """Refuse to measure nothing."""
        if self.lobe_cones not in get_args(LobeCones):
            raise ValueError(
                f"GBufferConfig.lobe_cones must be one of {get_args(LobeCones)}, "
                f"got {self.lobe_cones!r}."
            )
        if self.lobe_sample_count < 1:
            raise ValueError(
                f"GBufferConfig.lobe_sample_count must be >= 1, got {self.lobe_sample_count}."
            )


def trace_gbuffer(
    scene: mi.Scene,
    ray: mi.RayDifferential3f,
    sample_index: mi.UInt32,
    config: GBufferConfig,
    *,
    has_specular: bool,
    has_passing: bool,
    active: bool | mi.Bool = True,
    lobe_kinds: mi.UInt32 | None = None,
) -> GBuffer:
    """Trace camera rays to their first surface.

    Parameters
    ----------
    scene
        Geometry and materials.
    ray
        Camera rays.
    sample_index
        Number of each ray in the picture; the same number makes the same random decisions.
    config
        Effort for measuring lobes.
    has_specular, has_passing
        Whether any BSDF of the scene has such lobes; code for lobes that none has is left out.
    active
        Lanes to trace.
    lobe_kinds
        Which table each BSDF's lobe has (`vctgi.scene.lobe_kinds`); None: none has one.
    """
    si = scene.ray_intersect(ray, int(mi.RayFlags.All), as_mask(False), as_mask(active))
    is_valid = si.is_valid()
    bsdf = si.bsdf(ray)
    is_mixed = is_valid & (bsdf.flags() & ~mi.UInt32(PLAIN_FLAGS) != 0)
    lobes = _sample_lobes(si, bsdf, sample_index, 0, 1, mi.Bool(is_valid))
    if has_specular or has_passing:
        # Only points that are not plainly diffuse need more than one sample.
        measured = _measure_lobes(si, bsdf, sample_index, config.lobe_sample_count, is_mixed)
        lobes = dr.select(is_mixed, measured, lobes)
    passed = (
        dr.select(is_valid, mi.Color3f(bsdf.eval_null_transmission(si, is_valid)), 0.0)
        if has_passing
        else mi.Color3f(0.0)
    )
    normal = face_forward(mi.Vector3f(si.sh_frame.n), -ray.d)
    axis, aperture = _cone_of_lobe(si, normal, ray.d, lobes.moment, lobes.moment_weight)
    if config.lobe_cones == "fitted" and lobe_kinds is not None:
        has_lobe = mi.Bool(is_valid) & (lobes.moment_weight > 0.0)
        fitted = _fitted_cone(si, bsdf, normal, lobe_kinds, has_lobe)
        axis = dr.select(fitted.is_known, fitted.axis, axis)
        aperture = dr.select(fitted.is_known, fitted.aperture, aperture)
    gbuffer = GBuffer(
        sample_index=sample_index,
        is_valid=mi.Bool(is_valid),
        position=dr.select(is_valid, si.p, 0.0),
        normal=normal,
        ray_direction=ray.d,
        depth=mi.Float(dr.select(is_valid, si.t, 0.0)),
        albedo=lobes.diffuse,
        specular_albedo=lobes.specular,
        specular_axis=axis,
        specular_aperture=aperture,
        passed=passed,
    )
    return ready_for_forward_mode(scene, gbuffer)


@dataclass
class _Lobes:
    """Sums over BSDF samples, each sample weighed by its albedo."""

    diffuse: mi.Color3f
    specular: mi.Color3f
    moment: mi.Vector3f
    moment_weight: mi.Float


def _measure_lobes(
    si: mi.SurfaceInteraction3f,
    bsdf: mi.BSDFPtr,
    sample_index: mi.UInt32,
    sample_count: int,
    active: mi.Bool,
) -> _Lobes:
    """Sum `sample_count` stratified samples of each BSDF, in a loop that is traced once."""
    width = dr.width(sample_index)

    def is_running(number: mi.UInt32, _lobes: _Lobes) -> mi.Bool:
        return active & (number < sample_count)

    def add_sample(number: mi.UInt32, lobes: _Lobes) -> tuple[mi.UInt32, _Lobes]:
        sample = _sample_lobes(si, bsdf, sample_index, number, sample_count, active)
        total = _Lobes(
            lobes.diffuse + sample.diffuse,
            lobes.specular + sample.specular,
            lobes.moment + sample.moment,
            lobes.moment_weight + sample.moment_weight,
        )
        return number + 1, total

    # Field by field: Dr.Jit knows the types of a record from the first variant that used it.
    start = _Lobes(
        dr.zeros(mi.Color3f, width),
        dr.zeros(mi.Color3f, width),
        dr.zeros(mi.Vector3f, width),
        dr.zeros(mi.Float, width),
    )
    _, lobes = dr.while_loop(
        state=(dr.zeros(mi.UInt32, width), start),
        cond=is_running,
        body=add_sample,
        labels=("number", "lobes"),
        label="measure_lobes",
        # A sum of samples that do not know each other needs no memory of them in reverse mode.
        max_iterations=-1,
    )
    return lobes


def _sample_lobes(
    si: mi.SurfaceInteraction3f,
    bsdf: mi.BSDFPtr,
    sample_index: mi.UInt32,
    number: int | mi.UInt32,
    sample_count: int,
    active: mi.Bool,
) -> _Lobes:
    """Take one of `sample_count` samples and sort it by the lobe that it took."""
    # The points of a sequence, moved as one: what they measure hardly differs between pixels.
    lobe = (mi.Float(number) + random_unit(sample_index, 0)) / sample_count
    place = kronecker_points(mi.UInt32(number))
    place += mi.Point2f(random_unit(sample_index, 1), random_unit(sample_index, 2))
    point = place - dr.floor(place)
    sample, raw = bsdf.sample(mi.BSDFContext(), si, as_component(lobe), point, as_mask(active))
    is_used = active & (sample.pdf > 0.0)
    weight = dr.select(is_used, mi.Color3f(raw), 0.0) / sample_count
    is_reflection = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Reflection)
    weight = dr.select(is_reflection, weight, 0.0)
    share = _diffuse_share(si, bsdf, sample, active)
    diffuse, specular = weight * share, weight * (1.0 - share)
    brightness = dr.mean(specular)
    return _Lobes(
        diffuse=diffuse,
        specular=specular,
        moment=brightness * sample.wo,
        moment_weight=mi.Float(brightness),
    )


def _diffuse_share(
    si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, sample: mi.BSDFSample3f, active: mi.Bool
) -> mi.Color3f:
    """Share of a sample's light that diffuse lobes reflect, by the lobes' values.

    Some BSDFs (`principled`, `mask`) do not heed a request for single lobes: where the parts do not
    add up to the whole, the lobe that was sampled takes all. The reference splits alike.
    """
    diffuse_only, others_only = mi.BSDFContext(), mi.BSDFContext()
    diffuse_only.type_mask = int(mi.BSDFFlags.Diffuse)
    others_only.type_mask = int(mi.BSDFFlags.All) & ~int(mi.BSDFFlags.Diffuse)
    whole, diffuse, others = (
        mi.Color3f(bsdf.eval(context, si, sample.wo, as_mask(active)))
        for context in (mi.BSDFContext(), diffuse_only, others_only)
    )
    is_split = dr.all(dr.abs(diffuse + others - whole) <= SPLIT_TOLERANCE * whole)
    is_split &= dr.max(whole) > 0.0
    drawn_diffuse = mi.has_flag(sample.sampled_type, mi.BSDFFlags.DiffuseReflection)
    drawn = dr.select(drawn_diffuse, mi.Color3f(1.0), mi.Color3f(0.0))
    # A quotient of equal numbers is not exactly one on a GPU, and rounding takes it above one.
    quotient = diffuse / dr.select(whole > 0.0, whole, 1.0)
    by_value = dr.select(diffuse >= whole, mi.Color3f(1.0), quotient)
    share = dr.select(is_split, by_value, drawn)
    # A mirror has no value to compare with: all that it reflects is not diffuse.
    is_smooth = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Smooth)
    return dr.select(is_smooth, share, 0.0)


SPLIT_TOLERANCE = 1e-4
"""Relative excess of the sum of single lobes over the whole that is rounding."""

PLAIN_FLAGS = 0x2 | 0x1000 | 0x2000 | 0x4000 | 0x8000 | 0x10000
"""Flags that a plainly diffuse BSDF may have: diffuse reflection, and those that are no lobe
(anisotropic, spatially varying, non-symmetric, front side, back side)."""


def _cone_of_lobe(
    si: mi.SurfaceInteraction3f,
    normal: mi.Vector3f,
    ray_direction: mi.Vector3f,
    moment: mi.Vector3f,
    weight: mi.Float,
) -> tuple[mi.Vector3f, mi.Float]:
    """Axis and aperture of the cone whose mean direction is the lobe's."""
    has_lobe = weight > 0.0
    mean = moment / as_component(dr.select(has_lobe, weight, 1.0))
    length = mi.Float(dr.norm(mean))
    mirrored = ray_direction - 2.0 * dr.dot(ray_direction, normal) * normal
    is_directed = has_lobe & (length > 0.0)
    axis = dr.select(
        is_directed,
        si.to_world(mean / as_component(dr.select(length > 0.0, length, 1.0))),
        mirrored,
    )
    aperture = dr.select(is_directed, aperture_from_mean_cosine(dr.minimum(length, 1.0)), 0.0)
    return dr.normalize(axis), aperture


@dataclass
class _FittedCone:
    """Cones out of the tables, where the BSDF has one."""

    is_known: mi.Bool
    axis: mi.Vector3f
    aperture: mi.Float


def _fitted_cone(
    si: mi.SurfaceInteraction3f,
    bsdf: mi.BSDFPtr,
    normal: mi.Vector3f,
    lobe_kinds: mi.UInt32,
    active: mi.Bool,
) -> _FittedCone:
    """Read the cone of each point's lobe from the table of its distribution."""
    kind, active = read_by_number(lobe_kinds, bsdf, active)
    active &= kind < len(TABLES)
    alpha = mi.Float(bsdf.eval_attribute_1("alpha", si, as_mask(active)))
    to_viewer = mi.Vector3f(si.to_world(si.wi))
    cosine = dr.dot(to_viewer, normal)
    aperture, tilt = read_lobe_cone(dr.select(active, kind, 0), alpha, mi.Float(cosine))
    across = as_component(cosine) * normal - to_viewer
    length = dr.norm(across)
    # Seen straight on, every plane is one of incidence, and the tilt is zero.
    across = dr.select(length > 0.0, across / dr.select(length > 0.0, length, 1.0), 0.0)
    sine, cosine_of_tilt = dr.sincos(tilt)
    axis = as_component(cosine_of_tilt) * normal + as_component(sine) * across
    return _FittedCone(active, dr.normalize(axis), aperture)
