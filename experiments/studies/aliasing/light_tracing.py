"""The truth of a moved scene: light of one bounce at a few points, by paths from a lamp.

Each path leaves the lamp, meets a surface, and is connected to every receiver. For a small lit
patch that fills little of a receiver's view, this is far less noisy than paths from the receiver.
Emission, intersection and reflectance are Mitsuba's.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.directions import PLASTIC_RATIO, offset_from_surface
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import half_extent

SHADOW_END = 0.999
"""Share of the way to a lit point at which a shadow ray stops: not to meet the surface itself."""


def traced_light(
    scene: mi.Scene, points: np.ndarray, normals: np.ndarray, path_count: int, seed: int
) -> np.ndarray:
    """Return incident radiance E / pi [point, rgb] of light that one diffuse surface scattered.

    Parameters
    ----------
    scene
        With one emitter, a lamp without extent, and diffuse surfaces.
    points, normals
        [point, 3] receivers.
    path_count
        Paths; a lattice over the lamp's directions.
    seed
        Shifts the lattice: different seeds give independent, unbiased estimates. The same seed
        sends the same paths into a scene that has moved.
    """
    (emitter,) = scene.emitters()
    shift = np.random.default_rng(seed).random(2)
    number = np.arange(path_count, dtype=np.float64)[:, None]
    steps = np.array([1.0 / PLASTIC_RATIO, 1.0 / PLASTIC_RATIO**2])
    place = mi.Point2f(((shift + number * steps) % 1.0).T.astype(np.float32))
    # A lamp without extent takes its direction from one of the two places.
    ray, weight = emitter.sample_ray(as_component(0.0), as_component(0.5), place, place)
    si = scene.ray_intersect(mi.Ray3f(ray), as_mask(True))
    albedo = si.bsdf().eval_diffuse_reflectance(si, si.is_valid())
    is_front = si.is_valid() & (dr.dot(mi.Vector3f(si.n), mi.Vector3f(ray.d)) < 0.0)
    flux = dr.select(is_front, mi.Color3f(weight) * mi.Color3f(albedo), 0.0)
    lit = offset_from_surface(mi.Point3f(si.p), mi.Vector3f(si.n), half_extent(scene))
    lit_normal = mi.Vector3f(si.n)
    dr.eval(flux, lit, lit_normal)

    count = len(points)
    lane = dr.arange(mi.UInt32, count * path_count)
    receiver, path = lane // path_count, lane % path_count
    normal = _gathered(normals, receiver)
    start = offset_from_surface(mi.Point3f(_gathered(points, receiver)), normal, half_extent(scene))
    way = mi.Vector3f(dr.gather(mi.Point3f, lit, path) - start)
    squared = dr.squared_norm(way)
    leaving = -dr.dot(dr.gather(mi.Vector3f, lit_normal, path), way)
    arriving = dr.dot(normal, way)
    is_facing = (leaving > 0.0) & (arriving > 0.0)
    shadow = mi.Ray3f(start, way)
    shadow.maxt = as_component(SHADOW_END)
    is_seen = is_facing & ~scene.ray_test(shadow, is_facing)
    share = dr.select(is_seen, leaving * arriving / dr.maximum(squared**2, 1e-12), 0.0)
    arrived = dr.gather(mi.Color3f, flux, path) * as_component(share)
    sums = [np.array(dr.block_sum(mi.Float(each), path_count)) for each in arrived]
    found: np.ndarray = np.stack(sums, axis=1).astype(np.float64) / (path_count * np.pi**2)
    return found


def _gathered(values: np.ndarray, index: mi.UInt32) -> mi.Vector3f:
    """Return rows of an array [row, 3]."""
    whole = mi.Vector3f(np.ascontiguousarray(values.T, dtype=np.float32))
    return dr.gather(mi.Vector3f, whole, index)
