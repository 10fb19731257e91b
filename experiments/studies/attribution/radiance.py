"""True outgoing radiance of what rays meet, by Mitsuba's path tracer."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.maths.stub_gaps import as_mask


def scattered_radiance(
    scene: mi.Scene, ray: mi.Ray3f, scattering_count: int, seed: int, active: mi.Bool
) -> mi.Color3f:
    """Light along rays that surfaces scattered 1 .. `scattering_count` times, one path a ray.

    Parameters
    ----------
    scene
        The scene.
    ray
        Rays; emission of what they meet themselves is left out.
    scattering_count
        Most scatterings, >= 1.
    seed
        Different seeds give independent estimates.
    active
        Lanes to trace; the others get 0.
    """
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, dr.width(ray.d))
    path = mi.load_dict({"type": "path", "max_depth": scattering_count + 1})
    light = path.sample(scene, sampler, mi.RayDifferential3f(ray), None, as_mask(active))[0]
    si = scene.ray_intersect(ray, as_mask(active))
    return mi.Color3f(dr.select(active, light - si.emitter(scene).eval(si), 0.0))
