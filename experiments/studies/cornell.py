"""One bounce of light in the Cornell box: receivers, exact light, and the path-traced truth.

The room is Mitsuba's own, moved against the lattice of the voxels as a phase asks. What is compared
is the incident indirect radiance E / pi at primary hits, albedo divided out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.cones import ConeSet
from vctgi.maths.directions import (
    PLASTIC_RATIO,
    face_forward,
    offset_from_surface,
    random_unit,
    unit_from_bits,
)
from vctgi.maths.stub_gaps import as_mask
from vctgi.scene.extent import half_extent
from vctgi.scene.triangles import extract_triangles

LIGHT_SAMPLES = 4
"""Samples of the light for each point of a surface whose outgoing radiance is asked for."""

SURFACE_GAP = 1e-4
"""Distance from which a point of a surface is looked at to learn its material, world units."""

PIXEL_PLACE = (1.0 / PLASTIC_RATIO, 1.0 / PLASTIC_RATIO**2)
"""Where a pixel is looked through."""

RAYS_PER_PASS = 1 << 20
"""Rays of the reference that are traced at a time; bounds the memory of a pass."""


@dataclass(frozen=True, kw_only=True)
class CornellBox:
    """The room at one place.

    Attributes
    ----------
    scene
        Mitsuba's scene.
    triangles
        [triangle, corner, 3] world space; every surface reflects on its front only.
    """

    scene: mi.Scene
    triangles: np.ndarray

    def radiance(self, points: np.ndarray, normals: np.ndarray, _owner: np.ndarray) -> np.ndarray:
        """Outgoing radiance [point, rgb] of direct light that surfaces reflect diffusely."""
        count = len(points)
        position = mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32))
        normal = mi.Vector3f(np.ascontiguousarray(normals.T, dtype=np.float32))
        ray = mi.Ray3f(mi.Point3f(dr.fma(normal, SURFACE_GAP, position)), -normal)
        si = self.scene.ray_intersect(ray, as_mask(True))
        total = dr.zeros(mi.Color3f, count)
        lane = dr.arange(mi.UInt32, count)
        for number in range(LIGHT_SAMPLES):
            total += _reflected(self.scene, si, lane, (number, LIGHT_SAMPLES), SURFACE_STREAM)
            dr.eval(total)
        return np.array(total / LIGHT_SAMPLES, dtype=np.float64).T


@dataclass(frozen=True, kw_only=True)
class Receivers:
    """Primary hits: [point, 3] places and unit normals."""

    points: np.ndarray
    normals: np.ndarray


SURFACE_STREAM, REFERENCE_STREAM, TURN_STREAM = 300, 400, 500
"""Hash streams of light samples on surfaces, of the reference, and of turned directions."""


def cornell_box(offset: np.ndarray) -> CornellBox:
    """Return the room moved by `offset`, world units."""
    moved = mi.ScalarTransform4f().translate(offset.tolist())
    description: Any = mi.cornell_box()  # type: ignore[no-untyped-call]
    for part in description.values():
        if isinstance(part, dict) and "to_world" in part:
            part["to_world"] = moved @ part["to_world"]
    scene: mi.Scene = mi.load_dict(description)
    return CornellBox(scene=scene, triangles=extract_triangles(scene).vertices)


def primary_hits(room: CornellBox, edge: int) -> Receivers:
    """Return what the camera sees through one place in each of `edge` x `edge` pixels.

    The place is an irrational one: the centre of a pixel may look exactly at an edge of the room,
    where a ray starts on two walls at once and a path tracer's answer means nothing.
    """
    sensor = room.scene.sensors()[0]
    index = dr.arange(mi.UInt32, edge * edge)
    place = mi.Point2f(
        (mi.Float(index % edge) + PIXEL_PLACE[0]) / edge,
        (mi.Float(index // edge) + PIXEL_PLACE[1]) / edge,
    )
    ray, _ = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5, 0.5))
    si = room.scene.ray_intersect(ray, as_mask(True))
    normal = face_forward(mi.Vector3f(si.n), -ray.d)
    is_valid = np.array(si.is_valid())
    return Receivers(
        points=np.array(si.p, dtype=np.float64).T[is_valid],
        normals=np.array(normal, dtype=np.float64).T[is_valid],
    )


def path_traced(room: CornellBox, at: Receivers, path_count: int, seed: int) -> np.ndarray:
    """Incident radiance E / pi [point, rgb] of light that one surface scattered.

    Parameters
    ----------
    room
        The room.
    at
        Receivers.
    path_count
        Paths a point, a power of two: a cosine-distributed ray and a light sample where it lands.
        The directions of a point are a shifted lattice, at random places for each seed.
    seed
        Different seeds give independent, unbiased estimates.
    """
    count = len(at.points)
    position = mi.Point3f(np.ascontiguousarray(at.points.T, dtype=np.float32))
    normal = mi.Vector3f(np.ascontiguousarray(at.normals.T, dtype=np.float32))
    total = np.zeros((count, 3))
    block = max(1, RAYS_PER_PASS // count)
    for begin in range(0, path_count, block):
        length = min(block, path_count - begin)
        lane = dr.arange(mi.UInt32, count * length)
        point, number = lane // length, lane % length + dr.opaque(mi.UInt32, begin)
        stream = dr.opaque(mi.UInt32, REFERENCE_STREAM + 4 * seed)
        place = _lattice(number, point, stream)
        local = mi.warp.square_to_cosine_hemisphere(place)
        n = dr.gather(mi.Vector3f, normal, point)
        start = offset_from_surface(
            dr.gather(mi.Point3f, position, point), n, half_extent(room.scene)
        )
        si = room.scene.ray_intersect(mi.Ray3f(start, mi.Frame3f(n).to_world(local)), as_mask(True))
        path = point * path_count + number
        seen = _reflected(room.scene, si, path, (0, 1), stream + 2)
        total += np.stack(
            [np.array(dr.block_sum(mi.Float(channel), length)) for channel in seen], axis=1
        )
    return total / path_count


def exact_rays(room: CornellBox, at: Receivers, cones: ConeSet, sample_count: int) -> np.ndarray:
    """Incident radiance E / pi [point, rgb] by real rays along the axes of a cone set.

    What a renderer that knew every surface exactly would get from these directions, each point's
    turned by an angle of its own: the error of the directions alone.

    Parameters
    ----------
    room
        The room.
    at
        Receivers.
    cones
        Their axes and weights; apertures are left aside.
    sample_count
        Samples of the light where a ray lands.
    """
    count = len(at.points)
    point = dr.arange(mi.UInt32, count)
    position = mi.Point3f(np.ascontiguousarray(at.points.T, dtype=np.float32))
    normal = mi.Vector3f(np.ascontiguousarray(at.normals.T, dtype=np.float32))
    sin, cos = dr.sincos(2.0 * math.pi * random_unit(point, TURN_STREAM))
    start = offset_from_surface(position, normal, half_extent(room.scene))
    total = np.zeros((count, 3))
    for number, (axis, weight) in enumerate(zip(cones.directions, cones.weights, strict=True)):
        # Opaque, so that all directions share one kernel.
        x, y, z = (dr.opaque(mi.Float, value) for value in axis)
        turned = mi.Vector3f(cos * x - sin * y, sin * x + cos * y, z)
        ray = mi.Ray3f(start, mi.Frame3f(normal).to_world(turned))
        si = room.scene.ray_intersect(ray, as_mask(True))
        path = point * cones.cone_count + dr.opaque(mi.UInt32, number)
        for sample in range(sample_count):
            seen = _reflected(room.scene, si, path, (sample, sample_count), TURN_STREAM + 1)
            total += weight / sample_count * np.array(seen, dtype=np.float64).T
    return total


def _lattice(number: mi.UInt32, point: mi.UInt32, stream: mi.UInt32) -> mi.Point2f:
    """Points of the R2 sequence, shifted at random for each receiver."""
    coordinates = []
    for axis in range(2):
        step = mi.UInt32(int(2**32 / PLASTIC_RATIO ** (axis + 1)))
        start = mi.UInt32(mi.Float64(random_unit(point, stream + axis)) * 2.0**32)
        coordinates.append(unit_from_bits(number * step + start))
    return mi.Point2f(*coordinates)


def _reflected(
    scene: mi.Scene,
    si: mi.SurfaceInteraction3f,
    lane: mi.UInt32,
    stratum: tuple[int, int],
    stream: int | mi.UInt32,
) -> mi.Color3f:
    """Direct light that diffuse surfaces reflect, by one light sample of a stratum of several."""
    number, count = stratum
    u = (mi.Float(number) + random_unit(lane, mi.UInt32(stream))) / count
    sample = mi.Point2f(u, random_unit(lane, mi.UInt32(stream) + 1 + number))
    found, weight = scene.sample_emitter_direction(si, sample, True, si.is_valid())
    bsdf = si.bsdf()
    # The view does not matter to a diffuse surface, but the side does.
    value = bsdf.eval(mi.BSDFContext(), si, si.to_local(found.d), si.is_valid())
    is_lit = si.is_valid() & (dr.dot(mi.Vector3f(si.n), si.to_world(si.wi)) > 0.0)
    return dr.select(is_lit, mi.Color3f(value * weight), 0.0)
