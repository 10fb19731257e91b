"""One pass of path tracing, split by scattering count and by the lobe of the first hit.

Every ray, BSDF and emitter is Mitsuba's, and so is the path tracer: what is written here is only
how its results are put together. With `path(n)` for Mitsuba's path integrator of `max_depth = n`,
which holds up to n - 1 scatterings, along the camera ray and along the ray that the first BSDF
sample sends on:

- `emission` is the emitter that the camera ray meets;
- `direct` is `path(2)` along the camera ray less that emission;
- `indirect` is the BSDF weight times (`path(k)` along the second ray less the emission which
  that ray meets: that light is part of `direct`);
- `rest` sends the ray on k times and takes all of `path(-1)` less the emission met.

Where every number of scatterings is wanted on its own, `path(j)` less `path(j - 1)` along the
second ray, drawn from copies of one sampler, is the light of exactly j scatterings: the limit on
the depth cuts a path short and changes nothing before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import drjit as dr
import mitsuba as mi

if TYPE_CHECKING:
    # What the stubs of Mitsuba call a mask; the real type depends on the variant
    from drjit.auto.ad import Bool

MASK_TOLERANCE: Final = 1e-3
"""Relative: the parts of a BSDF which heeds lobe masks sum to the whole up to float32 rounding;
in a BSDF that ignores them they sum to twice the whole."""


@dataclass(frozen=True)
class Tracer:
    """What a pass needs besides its seed: Mitsuba objects and the split that is asked for."""

    scene: mi.Scene
    sensor: mi.Sensor
    scattering_count: int
    has_specular: bool
    """Whether any BSDF of the scene has a lobe that is not diffuse."""
    is_split_by_count: bool = False
    """As in `ReferenceRequest`."""


class TracePass(Protocol):
    """One sample per lane of one or more components: `trace_components` or `trace_rest`."""

    def __call__(
        self, tracer: Tracer, sampler: mi.Sampler, pixels: mi.UInt32
    ) -> dict[str, mi.Spectrum]:
        """Trace as `trace_components` does."""


def trace_components(
    tracer: Tracer, sampler: mi.Sampler, pixels: mi.UInt32
) -> dict[str, mi.Spectrum]:
    """One sample of each component up to `scattering_count` for every entry of `pixels`.

    Parameters
    ----------
    tracer
        Scene, sensor and split.
    sampler
        Seeded for as many lanes as `pixels` has.
    pixels
        Index `y * width + x` in the film's crop window.

    Returns
    -------
    dict
        `emission`, `direct`, `indirect_diffuse` and, if the scene has such lobes,
        `indirect_specular`, or these for each number of scatterings; per lane, W m^-2 sr^-1.
    """
    scene = tracer.scene
    ray, importance = _camera_ray(tracer.sensor, sampler, pixels)
    si = scene.ray_intersect(mi.Ray3f(ray))

    # ------------------- zero and one scattering -------------------
    emission = _emission(scene, si)
    direct = _path(2).sample(scene, sampler, ray)[0] - emission
    samples = {"emission": importance * emission, "direct": importance * direct}

    # -------------------- two to k scatterings --------------------
    sent_on, weight, diffuse_share = _scatter_first(tracer, sampler, si, ray)
    active = dr.any(weight != 0.0)
    for ending, incident in _indirect(tracer, sampler, sent_on, active).items():
        indirect = dr.select(active, importance * weight * incident, mi.Spectrum(0.0))
        samples |= _by_lobe(tracer, "indirect", ending, indirect, diffuse_share)
    return samples


def trace_rest(tracer: Tracer, sampler: mi.Sampler, pixels: mi.UInt32) -> dict[str, mi.Spectrum]:
    """One sample of the light with more than `scattering_count` scatterings, unlimited.

    Parameters and units as in `trace_components`; Russian roulette is the path integrator's own.
    """
    scene = tracer.scene
    ray, importance = _camera_ray(tracer.sensor, sampler, pixels)
    si = scene.ray_intersect(mi.Ray3f(ray), dr.any(importance != 0.0))
    sent_on, weight, diffuse_share = _scatter_first(tracer, sampler, si, ray)
    throughput = importance * weight
    active = dr.any(throughput != 0.0)
    for _ in range(tracer.scattering_count - 1):
        si = scene.ray_intersect(sent_on, active)
        sent_on, weight, _sample = _scatter(si, sent_on, sampler, active & si.is_valid())
        throughput *= weight
        active &= dr.any(throughput != 0.0)
    incident = light_scattered(-1, scene, sampler, sent_on, active)
    rest = dr.select(active, throughput * incident, mi.Spectrum(0.0))
    if tracer.is_split_by_count:
        return _by_lobe(tracer, "rest", "", rest, diffuse_share)
    return {"rest": rest}


def heeds_lobe_mask(bsdf: mi.BSDF, probe_count: int = 1024) -> bool:
    """Whether a BSDF's diffuse and other lobes, evaluated apart, sum to the whole.

    Mitsuba's `principled` and `principledthin` evaluate all lobes whatever the context asks for.

    Parameters
    ----------
    bsdf
        Any BSDF; evaluated for random directions over the sphere and random texture coordinates.
    probe_count
        Pairs of directions.
    """
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, probe_count)
    si = dr.zeros(mi.SurfaceInteraction3f, probe_count)
    # Any finite distance makes the interaction valid
    si.t = sampler.next_1d()
    si.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    si.n = mi.Normal3f(0.0, 0.0, 1.0)
    si.dp_du, si.dp_dv = mi.Vector3f(1.0, 0.0, 0.0), mi.Vector3f(0.0, 1.0, 0.0)
    si.uv = sampler.next_2d()
    si.wi = mi.warp.square_to_uniform_sphere(sampler.next_2d())
    wo = mi.warp.square_to_uniform_sphere(sampler.next_2d())
    return bool(dr.all(_lobes(mi.BSDFPtr(bsdf), si, wo, si.is_valid())[2]))


def _camera_ray(
    sensor: mi.Sensor, sampler: mi.Sampler, pixels: mi.UInt32
) -> tuple[mi.RayDifferential3f, mi.Spectrum]:
    """Draw a ray through a uniformly chosen point of each pixel (box filter), with its weight."""
    film = sensor.film()
    width, height = film.crop_size()
    row = pixels // dr.opaque(mi.UInt32, width)
    column = pixels - row * dr.opaque(mi.UInt32, width)
    position = (mi.Point2f(column, row) + sampler.next_2d()) / mi.Point2f(width, height)
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    time = sensor.shutter_open() + sampler.next_1d() * sensor.shutter_open_time()
    # The second argument chooses wavelengths, which an RGB variant does not have
    return sensor.sample_ray_differential(time, sampler.next_1d(), position, aperture)


def _path(max_depth: int) -> mi.SamplingIntegrator:
    """Mitsuba's path integrator: up to `max_depth` - 1 scatterings, -1 for any number."""
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth})
    assert isinstance(integrator, mi.SamplingIntegrator), "path is a sampling integrator"
    return integrator


def _emission(scene: mi.Scene, si: mi.SurfaceInteraction3f) -> mi.Spectrum:
    """Radiance of the emitter, or of the environment, that a ray has met."""
    return si.emitter(scene).eval(si)


def light_scattered(
    max_depth: int, scene: mi.Scene, sampler: mi.Sampler, ray: mi.Ray3f, active: Bool
) -> mi.Spectrum:
    """Radiance along a ray by `path`, less the emission met; undefined where not active.

    A sum in floats is never below its larger part, so the difference is never negative.
    """
    radiance, _, _ = _path(max_depth).sample(
        scene, sampler, mi.RayDifferential3f(ray), None, active
    )
    return radiance - _emission(scene, scene.ray_intersect(ray, active))


def _indirect(
    tracer: Tracer, sampler: mi.Sampler, ray: mi.Ray3f, active: Bool
) -> dict[str, mi.Spectrum]:
    """Scattered light along the second ray, by what the names of its components end with."""
    if not tracer.is_split_by_count:
        count = tracer.scattering_count
        return {"": light_scattered(count, tracer.scene, sampler, ray, active)}
    met = {}
    before = _emission(tracer.scene, tracer.scene.ray_intersect(ray, active))
    for count in range(2, tracer.scattering_count + 1):
        same_numbers = sampler.clone()
        up_to_count, _, _ = _path(count).sample(
            tracer.scene, same_numbers, mi.RayDifferential3f(ray), None, active
        )
        met[f"_{count}"] = up_to_count - before
        before = up_to_count
    return met


def _by_lobe(
    tracer: Tracer, name: str, ending: str, light: mi.Spectrum, diffuse_share: mi.Spectrum
) -> dict[str, mi.Spectrum]:
    """Divide light among the lobes of the first hit; a lobe that no BSDF has is left out."""
    parts = {f"{name}_diffuse{ending}": light * diffuse_share}
    if tracer.has_specular:
        parts[f"{name}_specular{ending}"] = light * (1.0 - diffuse_share)
    return parts


def _scatter(
    si: mi.SurfaceInteraction3f, ray: mi.Ray3f, sampler: mi.Sampler, active: Bool
) -> tuple[mi.Ray3f, mi.Spectrum, mi.BSDFSample3f]:
    """Send a ray on by the BSDF's own sampling: next ray, value over density, the sample."""
    sample, weight = si.bsdf(mi.RayDifferential3f(ray)).sample(
        mi.BSDFContext(), si, sampler.next_1d(active), sampler.next_2d(active), active
    )
    weight = dr.select(active & (sample.pdf > 0.0), weight, 0.0)
    return si.spawn_ray(si.to_world(sample.wo)), weight, sample


def _scatter_first(
    tracer: Tracer, sampler: mi.Sampler, si: mi.SurfaceInteraction3f, ray: mi.RayDifferential3f
) -> tuple[mi.Ray3f, mi.Spectrum, mi.Spectrum]:
    """`_scatter` with the share of the weight, per channel, that is the diffuse lobe's.

    All lobes are sampled together and the weight is divided afterwards in proportion to their
    values. Sampling one lobe by a restricted context would be the shorter way, but in Mitsuba
    3.9 `mask`, `pplastic` and `blendbsdf` (of a smooth and a delta BSDF) then return weights that
    do not sum to the whole. Where the BSDF does not tell its lobes apart, the kind of lobe which
    the direction was drawn from takes all.
    """
    valid = si.is_valid()
    sent_on, weight, sample = _scatter(si, ray, sampler, valid)
    if not tracer.has_specular:
        return sent_on, weight, mi.Spectrum(1.0)
    kind = sample.sampled_type
    whole, diffuse, is_split = _lobes(si.bsdf(ray), si, sample.wo, valid)
    drawn = dr.select((kind & int(mi.BSDFFlags.Diffuse)) != 0, mi.Spectrum(1.0), mi.Spectrum(0.0))
    # A quotient of equal numbers is not exactly one on a GPU, and rounding takes it above one
    share = dr.select(diffuse >= whole, mi.Spectrum(1.0), diffuse / whole)
    share = dr.select(whole > 0.0, share, mi.Spectrum(0.0))
    share = dr.select(is_split & (dr.max(whole) > 0.0), share, drawn)
    # A delta lobe has no value to compare with: all that it carries is not diffuse
    is_smooth = (kind & int(mi.BSDFFlags.Smooth)) != 0
    return sent_on, weight, dr.select(is_smooth, share, mi.Spectrum(0.0))


def _lobes(
    bsdf: mi.BSDFPtr, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, active: Bool
) -> tuple[mi.Spectrum, mi.Spectrum, Bool]:
    """Value of a BSDF, value of its diffuse lobe, and whether the parts sum to the whole."""
    diffuse, others = mi.BSDFContext(), mi.BSDFContext()
    diffuse.type_mask = int(mi.BSDFFlags.Diffuse)
    others.type_mask = int(mi.BSDFFlags.All) & ~int(mi.BSDFFlags.Diffuse)
    whole = bsdf.eval(mi.BSDFContext(), si, wo, active)
    diffuse_part = bsdf.eval(diffuse, si, wo, active)
    excess = dr.abs(diffuse_part + bsdf.eval(others, si, wo, active) - whole)
    return whole, diffuse_part, dr.all(excess <= MASK_TOLERANCE * whole)
