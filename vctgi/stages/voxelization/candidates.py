"""Which triangles come near which boxes of voxels, by their bounds.

Each triangle is read once and held against every box, so that a few small boxes cost little more
than reading the triangles, however many those are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.regions import Region
from vctgi.stages.voxelization.runs import lay_out_runs
from vctgi.stages.voxelization.triangles import DeviceTriangles


@dataclass
class Candidates:
    """Pairs of a triangle and a region that it may fill, one lane each."""

    triangle: mi.UInt32
    region: mi.UInt32


@dataclass
class _Boxes:
    """Regions with their reach in world units, flat [region, axis]."""

    low: mi.Float64
    high: mi.Float64
    count: mi.UInt32


def _boxes(regions: Sequence[Region], reach_voxels: float) -> _Boxes:
    low, high = [], []
    for region in regions:
        size = region.level.voxel_size
        low += [(i - reach_voxels) * size for i in region.low]
        high += [(i + reach_voxels) * size for i in region.high]
    return _Boxes(mi.Float64(low), mi.Float64(high), dr.opaque(mi.UInt32, len(regions)))


class _Bounds:
    """Bounds of triangles, one lane each."""

    def __init__(self, batch: DeviceTriangles, triangle: mi.UInt32) -> None:
        stride = dr.opaque(mi.UInt32, batch.count)
        self.low, self.high = [], []
        for axis in range(3):
            a, b, c = (
                dr.gather(mi.Float64, corner, axis * stride + triangle) for corner in batch.corners
            )
            self.low.append(dr.minimum(dr.minimum(a, b), c))
            self.high.append(dr.maximum(dr.maximum(a, b), c))

    def is_near(self, boxes: _Boxes, region: mi.UInt32) -> mi.Bool:
        near = mi.Bool(True)
        for axis in range(3):
            near &= self.high[axis] >= dr.gather(mi.Float64, boxes.low, 3 * region + axis)
            near &= self.low[axis] <= dr.gather(mi.Float64, boxes.high, 3 * region + axis)
        return near


def find_candidates(
    batch: DeviceTriangles, regions: Sequence[Region], reach_voxels: float
) -> Candidates | None:
    """Return all pairs of a triangle and a region that it may fill; None if there are none.

    Parameters
    ----------
    batch
        Triangles.
    regions
        Boxes to fill.
    reach_voxels
        How far from a triangle's bounds a voxel that it fills may lie.

    Raises
    ------
    ValueError
        More pairs than 32 bits count.
    """
    boxes = _boxes(regions, reach_voxels)
    all_bounds = _Bounds(batch, dr.arange(mi.UInt32, batch.count))

    def count_one(region: mi.UInt32, found: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        is_near = all_bounds.is_near(boxes, region)
        return region + 1, found + dr.select(is_near, mi.UInt32(1), 0)

    none = dr.zeros(mi.UInt32, batch.count)
    _, counts = dr.while_loop(
        state=(none, mi.UInt32(none)),
        cond=lambda region, found: region < boxes.count,
        body=count_one,
        label="count_candidates",
    )
    runs = lay_out_runs(mi.UInt32(counts))
    if runs is None:
        raise ValueError(
            f"find_candidates: {batch.count} triangles in {len(regions)} boxes are more pairs than "
            "32 bits count; update fewer boxes at a time."
        )
    if runs.total == 0:
        return None
    triangle, region_of = dr.zeros(mi.UInt32, runs.total), dr.zeros(mi.UInt32, runs.total)
    lane = dr.arange(mi.UInt32, batch.count)

    def write_one(region: mi.UInt32, place: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        is_near = all_bounds.is_near(boxes, region)
        dr.scatter(triangle, lane, place, is_near)
        dr.scatter(region_of, region, place, is_near)
        return region + 1, place + dr.select(is_near, mi.UInt32(1), 0)

    dr.while_loop(
        state=(mi.UInt32(none), runs.starts),
        cond=lambda region, place: region < boxes.count,
        body=write_one,
        label="write_candidates",
    )
    dr.eval(triangle, region_of)
    return Candidates(triangle, region_of)


def occupied_regions(
    triangles: Sequence[DeviceTriangles], regions: Sequence[Region], reach_voxels: float
) -> list[Region]:
    """Return the boxes that the bounds of some triangle come near, within `reach_voxels`."""
    if not regions:
        return []
    boxes = _boxes(regions, reach_voxels)
    is_occupied = dr.zeros(mi.UInt32, len(regions))
    for batch in triangles:
        bounds = _Bounds(batch, dr.arange(mi.UInt32, batch.count))

        def mark_one(region: mi.UInt32, bounds: _Bounds = bounds) -> tuple[mi.UInt32]:
            dr.scatter(is_occupied, mi.UInt32(1), region, bounds.is_near(boxes, region))
            return (region + 1,)

        dr.while_loop(
            state=(dr.zeros(mi.UInt32, batch.count),),
            cond=lambda region: region < boxes.count,
            body=mark_one,
            label="occupied_regions",
        )
        dr.eval(is_occupied)
    flags = np.array(is_occupied)
    return [region for region, flag in zip(regions, flags, strict=True) if flag]
