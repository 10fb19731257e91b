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

ALL_PAIRS_UP_TO = 1 << 18
"""Pairs up to which finding out which of them are near costs more than looking at all."""


@dataclass
class Candidates:
    """Pairs of a triangle and a region that it may fill, one lane each."""

    triangle: mi.UInt32
    region: mi.UInt32


@dataclass
class _Boxes:
    """Regions with their reach in world units, flat [region, axis], rounded outwards."""

    low: mi.Float
    high: mi.Float
    count: mi.UInt32


def _boxes(regions: Sequence[Region], reach_voxels: float) -> _Boxes:
    size = np.array([[region.level.voxel_size] for region in regions])
    low = (np.array([region.low for region in regions]) - reach_voxels) * size
    high = (np.array([region.high for region in regions]) + reach_voxels) * size
    below = np.nextafter(low.astype(np.float32), np.float32(-np.inf))
    above = np.nextafter(high.astype(np.float32), np.float32(np.inf))
    return _Boxes(
        mi.Float(below.ravel()), mi.Float(above.ravel()), dr.opaque(mi.UInt32, len(regions))
    )


class _Bounds:
    """Bounds of triangles, one lane each."""

    def __init__(self, triangles: DeviceTriangles, triangle: mi.UInt32) -> None:
        stride = dr.opaque(mi.UInt32, triangles.count)
        places = [axis * stride + triangle for axis in range(3)]
        self.low = [dr.gather(mi.Float, triangles.low, place) for place in places]
        self.high = [dr.gather(mi.Float, triangles.high, place) for place in places]

    def is_near(self, boxes: _Boxes, region: mi.UInt32) -> mi.Bool:
        """Whether they come near a box."""
        near = mi.Bool(True)
        for axis in range(3):
            near &= self.high[axis] >= dr.gather(mi.Float, boxes.low, 3 * region + axis)
            near &= self.low[axis] <= dr.gather(mi.Float, boxes.high, 3 * region + axis)
        return near


def find_candidates(
    triangles: DeviceTriangles, regions: Sequence[Region], reach_voxels: float
) -> Candidates | None:
    """Return all pairs of a triangle and a region that it may fill; None if there are none.

    Parameters
    ----------
    triangles
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
    if triangles.count == 0:
        return None
    boxes = _boxes(regions, reach_voxels)
    near = _near_any(triangles, boxes)
    if dr.width(near) == 0:
        return None
    if dr.width(near) * len(regions) <= ALL_PAIRS_UP_TO:
        return _all_pairs(near, len(regions))
    bounds = _Bounds(triangles, near)

    def count_one(region: mi.UInt32, found: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        is_near = bounds.is_near(boxes, region)
        return region + 1, found + dr.select(is_near, mi.UInt32(1), 0)

    none = dr.zeros(mi.UInt32, dr.width(near))
    _, counts = dr.while_loop(
        state=(none, mi.UInt32(none)),
        cond=lambda region, found: region < boxes.count,
        body=count_one,
        label="count_candidates",
    )
    runs = lay_out_runs(mi.UInt32(counts))
    if runs is None:
        raise ValueError(
            f"find_candidates: {triangles.count} triangles in {len(regions)} boxes are more pairs "
            "than 32 bits count; update fewer boxes at a time."
        )
    triangle, region_of = dr.zeros(mi.UInt32, runs.total), dr.zeros(mi.UInt32, runs.total)

    def write_one(region: mi.UInt32, place: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32]:
        is_near = bounds.is_near(boxes, region)
        dr.scatter(triangle, near, place, is_near)
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


def _all_pairs(near: mi.UInt32, region_count: int) -> Candidates:
    """Pair every triangle with every region."""
    width = dr.opaque(mi.UInt32, dr.width(near))
    lane = dr.arange(mi.UInt32, dr.width(near) * region_count)
    pairs = Candidates(dr.gather(mi.UInt32, near, lane % width), lane // width)
    dr.eval(pairs)
    return pairs


def _near_any(triangles: DeviceTriangles, boxes: _Boxes) -> mi.UInt32:
    """Return the triangles that come near some box."""
    bounds = _Bounds(triangles, dr.arange(mi.UInt32, triangles.count))
    none = dr.zeros(mi.UInt32, triangles.count)

    def look(region: mi.UInt32, is_near: mi.Bool) -> tuple[mi.UInt32, mi.Bool]:
        return region + 1, is_near | bounds.is_near(boxes, region)

    _, is_near = dr.while_loop(
        state=(none, none != 0),
        cond=lambda region, is_near: (region < boxes.count) & ~is_near,
        body=look,
        label="near_any",
    )
    return mi.UInt32(dr.compress(mi.Bool(is_near)))


def occupied_regions(
    triangles: DeviceTriangles, regions: Sequence[Region], reach_voxels: float
) -> list[Region]:
    """Return the boxes that the bounds of some triangle come near, within `reach_voxels`."""
    if not regions or triangles.count == 0:
        return []
    boxes = _boxes(regions, reach_voxels)
    is_occupied = dr.zeros(mi.UInt32, len(regions))
    bounds = _Bounds(triangles, dr.arange(mi.UInt32, triangles.count))

    def mark_one(region: mi.UInt32) -> tuple[mi.UInt32]:
        dr.scatter(is_occupied, mi.UInt32(1), region, bounds.is_near(boxes, region))
        return (region + 1,)

    dr.while_loop(
        state=(dr.zeros(mi.UInt32, triangles.count),),
        cond=lambda region: region < boxes.count,
        body=mark_one,
        label="occupied_regions",
    )
    flags = np.array(is_occupied)
    return [region for region, flag in zip(regions, flags, strict=True) if flag]
