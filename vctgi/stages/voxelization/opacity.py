"""Opacity of every clip level by voxelizing all surfaces at that level's own resolution.

The opacity of a voxel along a direction is the covered share of its face across that direction by
surfaces that a ray travelling so meets from their front. The mips behind the coarsest level are
left at zero; downsampling fills them, and replaces what a finer window covers.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.voxelization.coverage import CELLS_PER_EDGE, DeviceTriangles, coverage_masks


def voxelize_opacity(surfaces: VoxelSurfaces, layout: ClipmapLayout) -> OpacityClipmap:
    """Voxelize surfaces at every clip level.

    Parameters
    ----------
    surfaces
        Sides of triangles, front-facing as they are wound.
    layout
        Windows to fill.

    Returns
    -------
    OpacityClipmap
        Coverage in steps of 1 / 64; zero in the mips.

    References
    ----------
    [Panteleev2014], slides "Voxelization for opacity".
    """
    batches = upload_triangles(surfaces)
    levels = []
    for level in layout.levels:
        opacity = dr.zeros(mi.Float, DIRECTION_COUNT * level.voxel_count)
        if level.level < layout.clip_level_count:
            for axis in range(3):
                masks = coverage_masks(batches, level, axis)
                covered = mi.Float(dr.popcnt(masks)) * (1.0 / CELLS_PER_EDGE**2)
                index = dr.arange(mi.UInt32, 2 * level.voxel_count) + 2 * axis * level.voxel_count
                dr.scatter(opacity, covered, index)
                dr.eval(opacity)
        levels.append(opacity)
    return OpacityClipmap(layout, levels)


def upload_triangles(surfaces: VoxelSurfaces) -> list[DeviceTriangles]:
    """Copy surfaces to the device, one batch for the opaque ones and one for each mask."""
    batches = []
    for mask_index in range(-1, len(surfaces.masks)):
        chosen = np.flatnonzero(surfaces.mask_index == mask_index)
        if len(chosen) == 0:
            continue
        vertices = surfaces.vertices[chosen]
        normal = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        # A wall that rounding tilts a little must not gain a slot across its plane.
        normal[np.abs(normal) < FLAT_NORMAL] = 0.0
        batches.append(
            DeviceTriangles(
                corners=[
                    [mi.Float64(np.ascontiguousarray(vertices[:, c, i])) for i in range(3)]
                    for c in range(3)
                ],
                uv=[
                    mi.Point2f(np.ascontiguousarray(surfaces.uv[chosen, c].T.astype(np.float32)))
                    for c in range(3)
                ],
                normal=[
                    mi.Float(np.ascontiguousarray(normal[:, i].astype(np.float32)))
                    for i in range(3)
                ],
                count=len(chosen),
                mask=None if mask_index < 0 else surfaces.masks[mask_index],
            )
        )
    return batches


FLAT_NORMAL = 1e-6
"""Normal components below this are the rounding of single-precision vertices."""
