"""Ambient occlusion by cones against real rays with the same falloff."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

import vctgi
from experiments.scenes import load_scene
from experiments.studies.check import Check, Measured, StudyContext
from vctgi.maths.directions import kronecker_points, offset_from_surface, random_unit
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.pipeline import Frame
from vctgi.scene.extent import half_extent

EDGE = (96, 48)
"""Picture, pixels, in the whole study and in the quick one."""

RAY_COUNT = 256
"""Rays of the truth a point."""

RANGES = {"short": 0.05, "default": 0.1, "infinite": None}
"""Ranges by name, as a share of the scene's longest edge."""

LARGEST_DIFFERENCE, LARGEST_BIAS = 0.06, 0.04
"""Mean absolute difference from the rays, and of the means; both in shares of the hemisphere."""


def checks() -> list[Check]:
    """Return the checks of ambient occlusion."""
    measures = {
        "mean difference from rays": (_difference, None, LARGEST_DIFFERENCE),
        "bias against rays": (_bias, -LARGEST_BIAS, LARGEST_BIAS),
    }
    return [
        Check(
            name=f"ambient occlusion, {name} range, {what}",
            configuration='preset "ambient", range '
            + ("infinite" if share is None else f"{share:g} of the scene's longest edge"),
            scene="built-in cornell_box, first surfaces",
            measure=partial(measure, share=share),
            limit_low=low,
            limit_high=high,
            goal=0.0,
        )
        for name, share in RANGES.items()
        for what, (measure, low, high) in measures.items()
    ]


def ambient_by_rays(
    scene: mi.Scene, position: mi.Point3f, normal: mi.Vector3f, reach: float, ray_count: int
) -> np.ndarray:
    """How open the hemisphere over points is, by cosine-distributed rays, [point] in [0, 1].

    Parameters
    ----------
    scene
        Geometry, all of which closes off.
    position, normal
        Points and unit normals.
    reach
        Distance at which a surface closes off 1/e of what it covers, world units; may be infinite.
    ray_count
        Rays a point, a lattice that each point shifts at random.
    """
    count = dr.width(position)
    point = dr.arange(mi.UInt32, count)
    start = offset_from_surface(position, normal, half_extent(scene))
    frame = mi.Frame3f(normal)
    shift = mi.Point2f(random_unit(point, 1), random_unit(point, 2))
    closed = dr.zeros(mi.Float, count)
    for number in range(ray_count):
        place = kronecker_points(dr.opaque(mi.UInt32, number)) + shift
        place -= dr.floor(place)
        ray = mi.Ray3f(start, frame.to_world(mi.warp.square_to_cosine_hemisphere(place)))
        si = scene.ray_intersect(ray, int(mi.RayFlags.Minimal), as_mask(False), as_mask(True))
        share = dr.exp(si.t * as_component(dr.opaque(mi.Float, -1.0 / reach)))
        closed += dr.select(si.is_valid(), share, 0.0)
        dr.eval(closed)
    return 1.0 - np.array(closed, dtype=np.float64) / ray_count


def _pictures(context: StudyContext, share: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Ambient occlusion [pixel] of the pixels that show a surface, by cones and by rays."""

    def render() -> tuple[np.ndarray, np.ndarray]:
        loaded = load_scene("cornell_box", resolution=EDGE[context.quick])
        config = vctgi.preset("ambient")
        config = replace(config, ambient=replace(config.ambient, range_share=share))
        prepared = vctgi.prepare_scene(loaded.scene, loaded.scene.sensors()[0], config)
        volume = vctgi.light_volume(prepared, config).volume
        frame = vctgi.render_frame(prepared, volume, config)
        is_seen = np.array(frame.depth)[..., 0].ravel() > 0.0
        reach = config.ambient.range_in(2.0 * float(half_extent(loaded.scene)[0]))
        exact = by_rays_in(loaded.scene, frame, reach, RAY_COUNT)
        assert frame.ambient is not None, "the preset renders ambient occlusion"
        return np.array(frame.ambient)[..., 0].ravel()[is_seen], exact[is_seen]

    return context.once(f"ambient, {share}", render)


def by_rays_in(scene: mi.Scene, frame: Frame, reach: float, ray_count: int) -> np.ndarray:
    """Return how open the hemisphere over the first surface of each pixel is, [pixel]."""
    position, normal = (
        np.array(each).reshape(-1, 3).T for each in (frame.position, frame.surface_normal)
    )
    return ambient_by_rays(
        scene,
        mi.Point3f(np.ascontiguousarray(position)),
        mi.Vector3f(np.ascontiguousarray(normal)),
        reach,
        ray_count,
    )


def _difference(context: StudyContext, share: float | None) -> Measured:
    found, exact = _pictures(context, share)
    return Measured(value=math.fsum(np.abs(found - exact)) / len(exact))


def _bias(context: StudyContext, share: float | None) -> Measured:
    found, exact = _pictures(context, share)
    return Measured(value=math.fsum(found - exact) / len(exact))
