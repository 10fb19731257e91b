"""Which boxes of voxels hold anything at all, so that those that do not cost nothing."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.regions import Region
from vctgi.clipmap.slots import MAX_THICKNESS
from vctgi.stages.voxelization.columns import region_table
from vctgi.stages.voxelization.triangles import DeviceTriangles

REACH_VOXELS = MAX_THICKNESS + 1.0
"""How far from a triangle's bounds a voxel that it fills may lie: thickness, nudge, samples."""


def occupied_regions(triangles: list[DeviceTriangles], regions: Sequence[Region]) -> list[Region]:
    """Return the boxes that the bounds of some triangle touch or nearly touch.

    Parameters
    ----------
    triangles
        All surfaces.
    regions
        Boxes to look into.
    """
    if not regions or not triangles:
        return []
    table = region_table(regions, [1] * len(regions))
    is_occupied = dr.zeros(mi.UInt32, len(regions))
    for batch in triangles:
        width = dr.opaque(mi.UInt32, batch.count)
        lane = dr.arange(mi.UInt32, len(regions) * batch.count)
        region, triangle = lane // width, lane % width
        per_voxel = dr.gather(mi.Float64, table.per_voxel, region)
        is_near = mi.Bool(True)
        for axis in range(3):
            a, b, c = (
                dr.gather(mi.Float64, corner, axis * width + triangle) * per_voxel
                for corner in batch.corners
            )
            low = dr.gather(mi.Int32, table.low, 3 * region + axis)
            high = low + dr.gather(mi.Int32, table.shape, 3 * region + axis)
            is_near &= dr.maximum(dr.maximum(a, b), c) >= mi.Float64(low) - REACH_VOXELS
            is_near &= dr.minimum(dr.minimum(a, b), c) <= mi.Float64(high) + REACH_VOXELS
        dr.scatter(is_occupied, mi.UInt32(1), region, is_near)
    flags = np.array(is_occupied)
    return [region for region, flag in zip(regions, flags, strict=True) if flag]
