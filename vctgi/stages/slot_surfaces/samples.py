"""Points spread evenly over the surfaces in a window, and what those surfaces reflect.

Triangles are split until they are short, so that points fall only where the window is; each part
gets points in proportion to its area, at least one.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import LevelLayout
from vctgi.maths.colors import channel_mean
from vctgi.maths.directions import kronecker_points, random_bits, random_unit
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.reflectance import hemispherical_albedo

SAMPLES_PER_FACE = 8.0
"""Points on a surface as large as a voxel's face."""

LARGEST_SAMPLE_COUNT = 1 << 22
"""Points of a level; scenes of more surface get fewer a face, but one for each triangle."""

LARGEST_EDGE_VOXELS = 16.0
"""Triangles with longer edges are split, so that points fall only where the window is."""

LIFT_VOXELS = 0.01
"""From how far before a surface its own point is looked up."""

INCIDENCE_STREAM = 700
"""Hash stream of the directions that light comes from, and the one after it."""


@dataclass
class SurfaceSamples:
    """Points of surfaces under light from everywhere.

    Attributes
    ----------
    position, normal
        World points, and the unit geometric normals of the voxelized sides.
    area
        Area that each stands for, less what lets light pass, world units^2.
    reflected
        Area times albedo: what leaves of an irradiance of 1, W.
    """

    position: mi.Point3f
    normal: mi.Vector3f
    area: mi.Float
    reflected: mi.Color3f

    @property
    def count(self) -> int:
        """Number of points."""
        return int(dr.width(self.position))


def shade_surfaces(
    scene: mi.Scene, vertices: np.ndarray, level: LevelLayout, samples_per_face: float
) -> SurfaceSamples:
    """Spread points over triangles and see what they reflect of light from all directions.

    Parameters
    ----------
    scene
        Geometry with its materials.
    vertices
        [triangle, corner, 3] world units, wound so that the side in question is the front.
    level
        Window; triangles outside of it get no points.
    samples_per_face
        Points on a surface as large as a voxel's face, > 0.
    """
    points, normals, areas = sample_surfaces(vertices, level, samples_per_face)
    if len(points) == 0:
        nothing = dr.zeros(mi.Float, 0)
        return SurfaceSamples(
            dr.zeros(mi.Point3f, 0), dr.zeros(mi.Vector3f, 0), nothing, dr.zeros(mi.Color3f, 0)
        )
    position = mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32))
    normal = mi.Vector3f(np.ascontiguousarray(normals.T, dtype=np.float32))
    area = mi.Float(np.ascontiguousarray(areas, dtype=np.float32))
    # A ray from just before the point finds the surface with all that its material may ask for.
    lift = LIFT_VOXELS * level.voxel_size
    ray = mi.Ray3f(mi.Point3f(dr.fma(normal, lift, position)), -normal)
    ray.maxt = as_component(4.0 * lift)
    si = scene.ray_intersect(ray, as_mask(True))
    number = _hash_of(position)
    place = mi.Point2f(*(random_unit(number, INCIDENCE_STREAM + i) for i in range(2)))
    from_front = mi.warp.square_to_cosine_hemisphere(place)
    si.wi = dr.select(mi.Frame3f.cos_theta(si.wi) < 0.0, -from_front, from_front)
    is_found = si.is_valid()
    opaque = 1.0 - channel_mean(mi.Color3f(si.bsdf().eval_null_transmission(si)))
    albedo = hemispherical_albedo(si, number)
    samples = SurfaceSamples(
        position=position,
        normal=normal,
        area=dr.select(is_found, area * opaque, 0.0),
        reflected=dr.select(is_found, as_component(area) * albedo, 0.0),
    )
    dr.eval(samples)
    return samples


def _hash_of(position: mi.Point3f) -> mi.UInt32:
    """Return a number for each point that depends on nothing but where it is."""
    number = mi.UInt32(0)
    for coordinate in position:
        bits = mi.UInt32(dr.reinterpret_array(mi.UInt32, mi.Float(coordinate)))
        number = random_bits(number, bits)
    return number


def sample_surfaces(
    vertices: np.ndarray, level: LevelLayout, samples_per_face: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points on the triangles of a window, spread by area, at least one a triangle.

    Parameters
    ----------
    vertices
        [triangle, corner, 3], world units.
    level
        The window.
    samples_per_face
        Points on a surface of one voxel's face.

    Returns
    -------
    tuple
        Points [n, 3], unit normals [n, 3], and the area that each stands for [n], world units^2.
    """
    parts = split_to_window(vertices, level)
    across = np.cross(parts[:, 1] - parts[:, 0], parts[:, 2] - parts[:, 0])
    doubled = np.linalg.norm(across, axis=1)
    parts, across, doubled = (kept[doubled > 0.0] for kept in (parts, across, doubled))
    if len(parts) == 0:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty(0)
    wanted = 0.5 * doubled * samples_per_face / level.voxel_size**2
    wanted *= min(1.0, LARGEST_SAMPLE_COUNT / float(wanted.sum()))
    counts = np.maximum(np.ceil(wanted), 1.0).astype(np.int64)
    owner = np.repeat(np.arange(len(parts)), counts)
    # Each part has a sequence of its own, so that its points do not depend on other triangles.
    local = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    place = np.array(kronecker_points(mi.UInt32(local.astype(np.uint32))), dtype=np.float64)
    # A square folded along its diagonal covers a triangle evenly.
    s, t = np.where(place.sum(axis=0) > 1.0, 1.0 - place, place)
    a, b, c = (parts[owner, corner] for corner in range(3))
    points = a + s[:, None] * (b - a) + t[:, None] * (c - a)
    normals = across[owner] / doubled[owner, None]
    return points, normals, (0.5 * doubled / counts)[owner]


def split_to_window(vertices: np.ndarray, level: LevelLayout) -> np.ndarray:
    """Return triangles [n, corner, 3] that meet a window, halved until their edges are short."""
    low, high = np.array(level.window_min), np.array(level.window_max)
    limit = LARGEST_EDGE_VOXELS * level.voxel_size
    done, rest = [], vertices
    while True:
        meets = (rest.max(axis=1) >= low).all(axis=1) & (rest.min(axis=1) <= high).all(axis=1)
        rest = rest[meets]
        lengths = np.linalg.norm(np.roll(rest, -1, axis=1) - rest, axis=2)
        is_short = lengths.max(axis=1, initial=0.0) <= limit
        done.append(rest[is_short])
        rest, lengths = rest[~is_short], lengths[~is_short]
        if len(rest) == 0:
            return np.concatenate(done)
        # Turn each triangle so that its longest edge goes from its first to its second corner.
        turn = (np.argmax(lengths, axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(rest, turn[..., None], axis=1), 1, 0)
        middle = 0.5 * (a + b)
        rest = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
