"""The albedo that voxels hold: surfaces under even light, injected as light is.

Points are sampled on every voxelized side and given the same irradiance; what they reflect goes
through the renderer's own light injection, and so does what a white surface would reflect there.
The quotient of the two is the mean albedo of the surfaces in a slot, however dense the points are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.clipmap.slots import DEFAULT_RULE, SlotRule
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.debug.voxels import LevelVoxels
from vctgi.maths.directions import DIRECTION_COUNT, kronecker_points
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.light_injection import inject_light
from vctgi.stages.reflective_shadow_map import hemispherical_albedo

SAMPLES_PER_FACE = 8.0
"""Points on a surface as large as a voxel's face."""

LARGEST_SAMPLE_COUNT = 1 << 22
"""Points of a level; scenes of more surface get fewer a face, but one for each triangle."""

LARGEST_EDGE_VOXELS = 16.0
"""Triangles with longer edges are split, so that points fall only where the window is."""

LIFT_VOXELS = 0.01
"""From how far before a surface its own point is looked up."""


@dataclass
class VoxelAlbedo:
    """Light that the slots of one level reflect, flat [direction, z, y, x].

    Attributes
    ----------
    reflected
        Reflected by the surfaces themselves.
    white
        Reflected if they were white: the weight of the samples in each slot.
    """

    reflected: mi.Color3f
    white: mi.Float

    def sampled_in(self, voxels: LevelVoxels) -> LevelVoxels:
        """Return `voxels` with the weight of the samples in the place of opacity."""
        return replace(voxels, opacity=self.white)


def voxel_albedo(
    scene: mi.Scene,
    surfaces: VoxelSurfaces,
    voxels: LevelVoxels,
    samples_per_face: float = SAMPLES_PER_FACE,
    rule: SlotRule = DEFAULT_RULE,
) -> VoxelAlbedo:
    """Return the albedo of the voxels of one level.

    Parameters
    ----------
    scene, surfaces
        Geometry with its materials, and its sides that are voxelized.
    voxels
        The level; only slots with opacity hold anything.
    samples_per_face
        Points on a surface as large as a voxel's face, > 0.
    rule
        How thick the surfaces were made.
    """
    window = voxels.level
    points, normals, areas = sample_surfaces(surfaces.vertices, window, samples_per_face)
    if len(points) == 0:
        nothing = dr.zeros(mi.Float, DIRECTION_COUNT * window.voxel_count)
        return VoxelAlbedo(dr.zeros(mi.Color3f, dr.width(nothing)), nothing)
    position = mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32))
    normal = mi.Vector3f(np.ascontiguousarray(normals.T, dtype=np.float32))
    flux = mi.Float(np.ascontiguousarray(areas * math.pi, dtype=np.float32))
    lit = _shade(scene, position, normal, flux, LIFT_VOXELS * window.voxel_size)
    # Injection knows whole clipmaps only: this is one of a single level.
    only = replace(window, level=0)
    layout = ClipmapLayout(levels=(only,), clip_level_count=1, centre=only.window_min)
    alone = OpacityClipmap(layout, [voxels.opacity], rule)
    reflected = inject_light([lit], alone).levels[0]
    # What would be reflected by white surfaces is the incident part.
    white = replace(lit, reflected_flux=lit.incident_flux)
    weight = mi.Float(inject_light([white], alone).levels[0].x)
    dr.eval(weight)
    return VoxelAlbedo(reflected, weight)


def _shade(
    scene: mi.Scene, position: mi.Point3f, normal: mi.Vector3f, flux: mi.Float, lift: float
) -> ReflectiveShadowMap:
    """Light points of surfaces from the side of a normal and see what they reflect."""
    # A ray from just before the point finds the surface with all that its material may ask for.
    ray = mi.Ray3f(mi.Point3f(dr.fma(normal, lift, position)), -normal)
    ray.maxt = as_component(4.0 * lift)
    si = scene.ray_intersect(ray, as_mask(True))
    albedo = hemispherical_albedo(si, dr.arange(mi.UInt32, dr.width(position)))
    passed = mi.Color3f(si.bsdf().eval_null_transmission(si))
    incident = dr.select(si.is_valid(), as_component(flux) * (1.0 - passed), 0.0)
    reflected = dr.select(si.is_valid(), as_component(flux) * albedo, 0.0)
    result = ReflectiveShadowMap(
        light_name="even light",
        level=None,
        position=position,
        normal=normal,
        incident_flux=incident,
        reflected_flux=reflected,
    )
    dr.eval(result)
    return result


def sample_surfaces(
    vertices: np.ndarray, level: LevelLayout, samples_per_face: float = SAMPLES_PER_FACE
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
    place = np.array(kronecker_points(dr.arange(mi.UInt32, len(owner))), dtype=np.float64)
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
