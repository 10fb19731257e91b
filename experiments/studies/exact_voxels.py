"""Voxels with exact light: what the representation makes of a scene when injection is perfect.

Each slot's emittance is its opacity times the mean outgoing radiance of the surfaces in it, the
mean taken by projected area over a dense grid of points on the surfaces. So whatever is wrong with
what cones then see is wrong with the voxels and the march, not with the light.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.addressing import is_inside, texel_from_voxel
from vctgi.clipmap.levels import ClipmapLayout, LevelLayout, lay_out_clipmap
from vctgi.clipmap.slots import MAX_THICKNESS, SlotRule, filled_layers, surface_slot
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume, pack_volume
from vctgi.maths.directions import DIRECTION_COUNT, other_axes
from vctgi.scene.materials import describe_material
from vctgi.scene.surfaces import VoxelSurfaces, select_surfaces
from vctgi.scene.triangles import extract_triangles
from vctgi.stages.downsampling import downsample
from vctgi.stages.voxelization.opacity import voxelize_opacity
from vctgi.stages.voxelization.triangles import unit_normals

Radiance = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Outgoing radiance [point, rgb], W m^-2 sr^-1, of points [point, 3] with their unit normals
[point, 3] and the number of their triangle [point]."""

RESOLUTION = 64
"""Voxels along an edge of the only clip level."""

WINDOW_SHARE = 1.3
"""Edge of the window over the longest edge of the scene's bounds."""

LEAST_EXTENT = 2.6
"""Smallest edge of a window, world units: that of a room two wide."""

POINTS_PER_EDGE = 8
"""Points on a surface along an edge of a voxel's face."""

WINDOW_REACH_VOXELS = MAX_THICKNESS + 1.0
"""How far outside a window a point may lie that fills voxels of it, at most."""

EVERYWHERE = (np.full(3, -np.inf), np.full(3, np.inf))
"""A box without end."""

MISSED_OPACITY = 1e-3
"""Share of all opacity that may lie in slots which no point falls into: slivers of coverage that
are smaller than a cell."""


def lay_out_window(triangles: np.ndarray) -> ClipmapLayout:
    """Return one level of 64^3 voxels and its mips around the origin, with room for a phase."""
    edge = float((triangles.max(axis=(0, 1)) - triangles.min(axis=(0, 1))).max())
    extent = max(LEAST_EXTENT, WINDOW_SHARE * edge)
    return lay_out_clipmap(
        (0.0, 0.0, 0.0),
        finest_voxel_size=extent / RESOLUTION,
        level_count=1,
        resolution=RESOLUTION,
    )


def light_exactly(scene: mi.Scene, layout: ClipmapLayout, radiance: Radiance) -> VoxelVolume:
    """Voxelize a scene and give every slot its exact light.

    Parameters
    ----------
    scene
        Its first camera decides the sides of two-sided surfaces.
    layout
        Where the voxels lie.
    radiance
        What leaves the surfaces.

    Raises
    ------
    ValueError
        Slots have opacity but no point of a surface falls into them.
    """
    surfaces = surfaces_in(scene)
    opacity = voxelize_opacity(surfaces, layout)
    emittance = exact_emittance(opacity, surfaces.vertices, radiance)
    opacity, lit = downsample(opacity, emittance)
    assert lit is not None, "downsampling keeps the emittance it is given"
    return pack_volume(opacity, lit)


def surfaces_in(scene: mi.Scene) -> VoxelSurfaces:
    """Return the sides of triangles that the renderer would voxelize."""
    triangles = extract_triangles(scene)
    materials = [describe_material(bsdf) for bsdf in triangles.bsdfs]
    return select_surfaces(scene, scene.sensors()[0], triangles, materials)


def exact_emittance(
    opacity: OpacityClipmap, triangles: np.ndarray, radiance: Radiance
) -> EmittanceClipmap:
    """Return opacity times mean outgoing radiance for the slots of every clip level.

    Parameters
    ----------
    opacity
        Of the triangles.
    triangles
        [triangle, corner, 3] world space, float64; the number of a triangle is its place here.
    radiance
        What leaves them.

    Raises
    ------
    ValueError
        Slots have opacity but no point of a surface falls into them.
    """
    layout = opacity.layout
    normals = unit_normals(triangles)
    levels = [
        _exact_level(opacity, level, (triangles, normals), radiance) for level in layout.clip_levels
    ]
    levels += [
        dr.zeros(mi.Color3f, DIRECTION_COUNT * each.voxel_count)
        for each in layout.levels[layout.clip_level_count :]
    ]
    return EmittanceClipmap(layout, levels, [0.0] * layout.clip_level_count)


def _exact_level(
    opacity: OpacityClipmap,
    level: LevelLayout,
    surfaces: tuple[np.ndarray, np.ndarray],
    radiance: Radiance,
) -> mi.Color3f:
    """Emittance of one clip level, from triangles and their normals."""
    triangles, normals = surfaces
    count = DIRECTION_COUNT * level.voxel_count
    filled: list[np.ndarray] = [np.zeros(0, dtype=np.int64)]
    colors: list[np.ndarray] = [np.zeros((0, 3))]
    reach = WINDOW_REACH_VOXELS * level.voxel_size
    low, high = np.array(level.window_min) - reach, np.array(level.window_max) + reach
    for axis in range(3):
        spacing = level.voxel_size / POINTS_PER_EDGE
        points, owner = grid_points(triangles, normals, axis, spacing, (low, high))
        if len(points) == 0:
            continue
        leaving = radiance(points, normals[owner], owner)
        for index, kept in _slots(points, normals[owner, axis], axis, level, opacity.rule):
            filled.append(index[kept])
            colors.append(leaving[kept])
    # Every point stands for the same projected area; NumPy adds in one fixed order.
    index, leaving = np.concatenate(filled), np.concatenate(colors)
    weights = np.bincount(index, minlength=count)
    alpha = np.array(opacity.levels[level.level])
    total = float(alpha.sum(dtype=np.float64))
    missed = float(alpha[weights == 0].sum(dtype=np.float64))
    if missed > MISSED_OPACITY * total:
        raise ValueError(
            f"exact_emittance: {missed / total:.2%} of the opacity of level {level.level} lies in "
            "slots that no point of a surface falls into; raise POINTS_PER_EDGE."
        )
    touched = np.flatnonzero(weights)
    color = np.zeros((3, count), dtype=np.float32)
    for channel, values in enumerate(leaving.T):
        sums = np.bincount(index, values, count)[touched]
        color[channel, touched] = alpha[touched] * (sums / weights[touched])
    return mi.Color3f(color)


def grid_points(
    triangles: np.ndarray,
    normals: np.ndarray,
    axis: int,
    spacing: float,
    box: tuple[np.ndarray, np.ndarray] = EVERYWHERE,
) -> tuple[np.ndarray, np.ndarray]:
    """Points of triangles above a regular grid across an axis, and the triangle of each.

    Parameters
    ----------
    triangles, normals
        [triangle, corner, 3] and [triangle, 3].
    axis
        The axis that the grid lies across.
    spacing
        Of the grid, whose points lie half a spacing from multiples of it, world units.
    box
        Lowest and highest corner of what is wanted.
    """
    u, v = other_axes(axis)
    found, owners = [], []
    for number, (corners, normal) in enumerate(zip(triangles, normals, strict=True)):
        if normal[axis] == 0.0:
            continue
        axes = []
        for across in (u, v):
            first = np.floor(max(corners[:, across].min(), box[0][across]) / spacing)
            last = np.ceil(min(corners[:, across].max(), box[1][across]) / spacing)
            axes.append((np.arange(first, last) + 0.5) * spacing)
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        origin, edges = corners[0][[u, v]], (corners[1:] - corners[0])[:, [u, v]]
        share = (grid - origin) @ np.linalg.inv(edges)
        share = share[(share >= 0.0).all(axis=1) & (share.sum(axis=1) <= 1.0)]
        points = corners[0] + share @ (corners[1:] - corners[0])
        points = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
        found.append(points)
        owners.append(np.full(len(points), number))
    if not found:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    return np.concatenate(found), np.concatenate(owners)


def _slots(
    points: np.ndarray, normal: np.ndarray, axis: int, level: LevelLayout, rule: SlotRule
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Storage index of each slot that points fill along an axis, and which points fill it.

    The normals are their components along the axis.
    """
    place = mi.Point3f(np.ascontiguousarray(points.T / level.voxel_size, dtype=np.float32))
    slot = surface_slot(mi.Float(np.ascontiguousarray(normal, dtype=np.float32)), rule)
    voxel = mi.Vector3i(dr.floor(place))
    for layer, is_filled in filled_layers(mi.Float(place[axis]), slot):
        voxel[axis] = layer
        texel = texel_from_voxel(voxel, level.resolution)
        index = texel + (2 * axis + slot.side) * level.voxel_count
        yield np.array(index, dtype=np.int64), np.array(is_filled & is_inside(voxel, level))


def scene_of(triangles: np.ndarray) -> mi.Scene:
    """Return triangles [triangle, corner, 3] as the one-sided surfaces of a Mitsuba scene."""
    mesh = mi.Mesh("surfaces", 3 * len(triangles), len(triangles))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(triangles.astype(np.float32).ravel())
    parameters["faces"] = dr.arange(mi.UInt32, 3 * len(triangles))
    parameters.update()
    camera = {"type": "perspective"}
    scene: mi.Scene = mi.load_dict({"type": "scene", "surfaces": mesh, "camera": camera})
    return scene
