"""The sides of triangles that go into the voxels, and what covers them.

A slot holds surfaces seen from their front, so it matters which side is the front. A one-sided BSDF
says so by its normal. A two-sided one does not, and meshes that are only ever drawn two-sided come
with any orientation: walls of a room wound outwards, curtains seen from both sides. For those, the
sides are the ones that light paths from the camera meet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.directions import (
    face_forward,
    front_normal,
    offset_from_surface,
    random_unit,
)
from vctgi.maths.stub_gaps import as_mask
from vctgi.scene.camera import survey_rays
from vctgi.scene.extent import half_extent
from vctgi.scene.materials import Material
from vctgi.scene.registry import registry_number, registry_numbers
from vctgi.scene.triangles import LiveCorners, SceneTriangles

SURVEY_RESOLUTION = 192
"""Camera rays along an edge of the survey's picture."""

SURVEY_BOUNCES = 2
"""Bounces of a surveying path after its first hit."""

PATHS_PER_HIT = 8
"""Paths that leave each first hit."""

MINOR_SHARE = 0.2
"""A side that gets a smaller share of a triangle's hits does not count as seen."""

FRONT, BACK = 1, 2
"""Bits of the sides of a triangle."""


@dataclass
class VoxelSurfaces:
    """What is voxelized.

    Attributes
    ----------
    vertices
        [side, corner, 3] world space, float64, counter-clockwise seen from the side in question.
    uv
        [side, corner, 2] texture coordinates.
    mask_index
        [side] index into `masks`, -1 for surfaces that are opaque all over.
    shape_index
        [side] which shape of the scene it belongs to.
    masks
        BSDFs whose null transmission decides the opacity of their surfaces.
    flipped_count
        Two-sided triangles that are seen only from the side that their winding calls the back.
    double_count
        Triangles that are seen from both sides.
    live
        Their corners with derivatives; None where they have none.
    """

    vertices: np.ndarray
    uv: np.ndarray
    mask_index: np.ndarray
    shape_index: np.ndarray
    masks: list[mi.BSDF]
    flipped_count: int
    double_count: int
    live: LiveCorners | None = None


def opaque_surfaces(vertices: np.ndarray) -> VoxelSurfaces:
    """Return one-sided opaque triangles [triangle, corner, 3] of one shape as they are."""
    count = len(vertices)
    return VoxelSurfaces(
        vertices=np.asarray(vertices, dtype=np.float64),
        uv=np.zeros((count, 3, 2)),
        mask_index=np.full(count, -1),
        shape_index=np.zeros(count, int),
        masks=[],
        flipped_count=0,
        double_count=0,
    )


def select_surfaces(
    scene: mi.Scene, sensor: mi.Sensor, triangles: SceneTriangles, materials: list[Material]
) -> VoxelSurfaces:
    """Return the sides of triangles that cones can meet from their front."""
    is_two_sided = np.array([m.is_two_sided for m in materials])[triangles.bsdf_index]
    sides = np.full(triangles.triangle_count, FRONT)
    if is_two_sided.any():
        seen = _seen_sides(_survey(scene, sensor, triangles), triangles)
        sides[is_two_sided] = seen[is_two_sided]
    front, back = np.flatnonzero(sides & FRONT), np.flatnonzero(sides & BACK)
    which = np.concatenate([front, back])
    order = np.array([[0, 1, 2]] * len(front) + [[0, 2, 1]] * len(back))
    rows = np.arange(len(which))[:, None]

    mask_of_bsdf = np.full(len(materials), -1)
    with_null = [index for index, material in enumerate(materials) if material.has_null]
    mask_of_bsdf[with_null] = np.arange(len(with_null))
    live = triangles.live
    if live is not None:
        live = replace(live, index=live.index[which][rows, order])
    return VoxelSurfaces(
        live=live,
        vertices=triangles.vertices[which][rows, order],
        uv=triangles.uv[which][rows, order],
        mask_index=mask_of_bsdf[triangles.bsdf_index[which]],
        shape_index=triangles.shape_index[which],
        masks=[triangles.bsdfs[index] for index in with_null],
        flipped_count=int(np.count_nonzero(sides == BACK)),
        double_count=int(np.count_nonzero(sides == FRONT | BACK)),
    )


def _seen_sides(votes: np.ndarray, triangles: SceneTriangles) -> np.ndarray:
    """Sides [triangle] from hit counts [triangle, (front, back)]."""
    total = votes.sum(axis=1)
    share = votes / np.maximum(total, 1)[:, None]
    seen = FRONT * (share[:, 0] >= MINOR_SHARE) + BACK * (share[:, 1] >= MINOR_SHARE)
    # Triangles that no path met follow the rest of their shape, and that the winding.
    shape_count = len(triangles.shape_names)
    per_shape = np.stack(
        [np.bincount(triangles.shape_index, votes[:, i], shape_count) for i in range(2)], axis=1
    )
    shape_side = np.where(per_shape[:, 1] > per_shape[:, 0], BACK, FRONT)
    sides: np.ndarray = np.where(total > 0, seen, shape_side[triangles.shape_index])
    return sides


def _survey(scene: mi.Scene, sensor: mi.Sensor, triangles: SceneTriangles) -> np.ndarray:
    """Count hits on the front and back of each triangle by diffuse paths from the camera."""
    votes = dr.zeros(mi.UInt32, 2 * triangles.triangle_count)
    first_face, kept = _face_lookup(scene, triangles)
    ray = survey_rays(sensor, SURVEY_RESOLUTION)
    si = scene.ray_intersect(ray, as_mask(True))
    _count(votes, si, ray.d, first_face, kept)

    # Every first hit sends out several paths; a lane is a path.
    lane = dr.arange(mi.UInt32, PATHS_PER_HIT * SURVEY_RESOLUTION**2)
    parent = lane // PATHS_PER_HIT
    p = dr.gather(mi.Point3f, si.p, parent)
    n = dr.gather(mi.Normal3f, si.n, parent)
    d = dr.gather(mi.Vector3f, ray.d, parent)
    is_valid = as_mask(dr.gather(mi.Bool, si.is_valid(), parent))
    extent = half_extent(scene)
    for bounce in range(SURVEY_BOUNCES):
        normal = face_forward(mi.Vector3f(n), -d)
        sample = mi.Point2f(random_unit(lane, 2 * bounce), random_unit(lane, 2 * bounce + 1))
        d = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(sample))
        ray = mi.Ray3f(offset_from_surface(mi.Point3f(p), normal, extent), d)
        si = scene.ray_intersect(ray, is_valid)
        is_valid &= si.is_valid()
        _count(votes, si, d, first_face, kept)
        p, n = si.p, si.n
        dr.eval(p, n, d, is_valid, votes)
    return np.array(votes, dtype=np.int64).reshape(-1, 2)


def _face_lookup(scene: mi.Scene, triangles: SceneTriangles) -> tuple[mi.Int32, mi.Int32]:
    """Return the first face of each shape by its registry number, and the triangle of each face."""
    numbers = [registry_number(mi.ShapePtr(shape)) for shape in scene.shapes()]
    first = np.full(max(numbers, default=0) + 1, -1)
    for shape, start in triangles.first_face:
        first[registry_number(mi.ShapePtr(shape))] = start
    return mi.Int32(first.astype(np.int32)), mi.Int32(triangles.kept.astype(np.int32))


def _count(
    votes: mi.UInt32,
    si: mi.SurfaceInteraction3f,
    d: mi.Vector3f,
    first_face: mi.Int32,
    kept: mi.Int32,
) -> None:
    """Add one vote for the side that each ray hit."""
    number = registry_numbers(si.shape)
    # Opaque: registry numbers differ from scene to scene, and kernels should not.
    is_known = si.is_valid() & (number < dr.opaque(mi.UInt32, dr.width(first_face)))
    start = dr.gather(mi.Int32, first_face, number, is_known)
    is_known &= start >= 0
    face = mi.UInt32(start) + si.prim_index
    triangle = dr.gather(mi.Int32, kept, face, is_known)
    is_known &= triangle >= 0
    side = dr.select(dr.dot(front_normal(si), d) < 0.0, mi.UInt32(0), mi.UInt32(1))
    # Dr.Jit's own choice on the CPU, a copy of the votes for each thread, writes their number into
    # the kernel: every scene would compile its own.
    dr.scatter_reduce(
        dr.ReduceOp.Add,
        votes,
        mi.UInt32(1),
        2 * mi.UInt32(triangle) + side,
        is_known,
        dr.ReduceMode.Local,
    )
