"""Columns: which voxel columns a triangle may cover, seen along each axis.

Along each axis a region is a square of voxel columns, each of which shows a face of 8 x 8 cells;
supersampling splits the face into several such squares. A triangle meets the columns that its
bounds touch. All regions, axes and triangles are enumerated in one launch: first
how many columns each triangle meets, then one lane for each column.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.regions import Region
from vctgi.clipmap.slots import BEHIND_NUDGE, SlotRule, SurfaceSlot, surface_slot
from vctgi.stages.voxelization.candidates import Candidates, find_candidates
from vctgi.stages.voxelization.runs import lay_out_runs, owners
from vctgi.stages.voxelization.triangles import DeviceTriangles

CELLS_PER_EDGE = 8
"""Cells along an edge of a face; their 64 bits fit one word."""

EDGE_TOLERANCE = 1e-6
"""How far outside an edge, in cells, a centre still counts as covered: shared edges that rounding
moves apart leave no cracks, and a bit set twice is set once."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """Which columns are enumerated."""

    has_rim: bool = False
    """Whether a column counts that a triangle's bounds touch without holding a cell's centre."""
    is_dominant_only: bool = False
    """Whether each triangle is seen along its axis of largest projected area alone."""
    margin_voxels: int = 0
    """How far outside a region columns are looked for, >= 0."""


BY_CENTRES = Search()

PAIRS_PER_PASS = 1 << 22
"""Triangles in regions that are looked at together; bounds the memory of a pass."""

COLUMNS_PER_PASS = 1 << 23
"""Columns that are filled together; bounds the memory of a pass."""


@dataclass
class RegionTable:
    """Regions as device arrays, to be looked up by a lane's own region.

    Attributes
    ----------
    regions
        The same on the host.
    per_voxel
        One over the voxel size, 1 / world units.
    low, shape
        Flat [region, axis], in voxels.
    supersampling
        Faces of 8 x 8 cells along an edge of a voxel.
    offset
        First word of the region's level in the result; a level has 6 x supersampling^2 words a
        voxel, ordered [slot, sub-face, voxel], with the voxels of its regions one after the other.
    first_voxel
        Place of the region's first voxel in that list.
    list_count
        Voxels of the list.
    word_count
        Words of all regions.
    """

    regions: Sequence[Region]
    per_voxel: mi.Float64
    low: mi.Int32
    shape: mi.Int32
    supersampling: mi.UInt32
    offset: mi.UInt32
    first_voxel: mi.UInt32
    list_count: mi.UInt32
    word_count: int


def region_table(regions: Sequence[Region], supersampling: Callable[[int], int]) -> RegionTable:
    """Return `regions`, those of one level side by side, as device arrays."""
    counts: dict[int, int] = {}
    first_voxel = []
    for region in regions:
        first_voxel.append(counts.get(region.level.level, 0))
        counts[region.level.level] = first_voxel[-1] + region.voxel_count
    offsets, total = {}, 0
    for level, count in counts.items():
        offsets[level] = total
        total += 6 * supersampling(level) ** 2 * count
    levels = [region.level.level for region in regions]
    return RegionTable(
        regions=regions,
        per_voxel=mi.Float64([1.0 / region.level.voxel_size for region in regions]),
        low=mi.Int32([i for region in regions for i in region.low]),
        shape=mi.Int32([i for region in regions for i in region.shape]),
        supersampling=mi.UInt32([supersampling(level) for level in levels]),
        offset=mi.UInt32([offsets[level] for level in levels]),
        first_voxel=mi.UInt32(first_voxel),
        list_count=mi.UInt32([counts[level] for level in levels]),
        word_count=total,
    )


@dataclass
class FaceView:
    """Triangles as seen along an axis of a region, each lane its own.

    Attributes
    ----------
    region, axis, triangle
        What is seen, along which axis, from which region.
    u, v
        Coordinates of the corners across the axis, in cells of the level's lattice.
    depth
        Coordinates along it, in voxels.
    slot
        Where the triangle goes along the axis.
    low_depth, high_depth
        Bounds of the depth, moved a little behind the surface.
    """

    region: mi.UInt32
    axis: mi.UInt32
    triangle: mi.UInt32
    u: list[mi.Float64]
    v: list[mi.Float64]
    depth: list[mi.Float64]
    slot: SurfaceSlot
    low_depth: mi.Float64
    high_depth: mi.Float64


@dataclass
class Columns:
    """Columns of voxels that triangles may cover, a lane each.

    Attributes
    ----------
    view
        The triangle of each column.
    face_u, face_v
        Face of the column across the axis, in sub-faces of the level's lattice.
    """

    view: FaceView
    face_u: mi.Int32
    face_v: mi.Int32


def view_along(
    triangles: DeviceTriangles,
    table: RegionTable,
    rule: SlotRule,
    lanes: tuple[mi.UInt32, mi.UInt32, mi.UInt32],
) -> FaceView:
    """See triangles along axes from regions; `lanes` is (triangle, region, axis)."""
    triangle, region, axis = lanes
    per_voxel = dr.gather(mi.Float64, table.per_voxel, region)
    cells = mi.Float64(CELLS_PER_EDGE * dr.gather(mi.UInt32, table.supersampling, region))
    across = [(axis + 1) % 3, (axis + 2) % 3]
    stride = dr.opaque(mi.UInt32, triangles.count)

    def along(which: mi.UInt32) -> list[mi.Float64]:
        index = which * stride + triangle
        return [dr.gather(mi.Float64, corner, index) * per_voxel for corner in triangles.corners]

    depth = along(axis)
    slot = surface_slot(dr.gather(mi.Float, triangles.normal, axis * stride + triangle), rule)
    nudge = mi.Float64(slot.behind) * BEHIND_NUDGE
    return FaceView(
        region=region,
        axis=axis,
        triangle=triangle,
        u=[u * cells for u in along(across[0])],
        v=[v * cells for v in along(across[1])],
        depth=depth,
        slot=slot,
        low_depth=dr.minimum(dr.minimum(depth[0], depth[1]), depth[2]) + nudge,
        high_depth=dr.maximum(dr.maximum(depth[0], depth[1]), depth[2]) + nudge,
    )


def filled_depths(view: FaceView) -> tuple[mi.Float64, mi.Float64]:
    """Depths between which the thickened triangle lies, in voxels."""
    thickness = mi.Float64(view.slot.thickness)
    is_upward = view.slot.behind > 0
    low = view.low_depth - dr.select(is_upward, 0.0, thickness)
    high = view.high_depth + dr.select(is_upward, thickness, 0.0)
    return low, high


def along_axis(values: mi.Int32, region: mi.UInt32, axis: mi.UInt32) -> mi.Int32:
    """Component `axis` of the row `region` of a flat table [region, axis]."""
    return dr.gather(mi.Int32, values, 3 * region + axis)


def enumerate_columns(
    triangles: DeviceTriangles, table: RegionTable, rule: SlotRule, search: Search = BY_CENTRES
) -> Iterator[Columns]:
    """Yield the columns that the bounds of triangles touch, pass by pass.

    Parameters
    ----------
    triangles
        Triangles.
    table
        Regions to fill.
    rule
        How thick surfaces are made.
    search
        Which of them count.
    """
    reach = rule.reach_voxels + search.margin_voxels
    candidates = find_candidates(triangles, table.regions, reach)
    pair_count = 0 if candidates is None else dr.width(candidates.triangle)
    for begin in range(0, pair_count, PAIRS_PER_PASS):
        assert candidates is not None, "there are pairs to look at"
        count = min(PAIRS_PER_PASS, pair_count - begin)
        # What differs from frame to frame is opaque, so that a moved camera compiles nothing.
        start, width = dr.opaque(mi.UInt32, begin), dr.opaque(mi.UInt32, count)
        lanes = _Lanes(candidates, start, width)
        first_u, first_v, count_u, column_count = _bounds(
            triangles, table, rule, lanes.at(dr.arange(mi.UInt32, 3 * count)), search
        )
        runs = lay_out_runs(column_count)
        if runs is None:
            raise ValueError(
                "enumerate_columns: a pass has more columns than 32 bits count; lower the "
                "clipmap's resolution."
            )
        for first in range(0, runs.total, COLUMNS_PER_PASS):
            last = min(first + COLUMNS_PER_PASS, runs.total)
            view_lane = owners(runs, first, last)
            number = dr.arange(mi.UInt32, last - first) + dr.opaque(mi.UInt32, first)
            local = number - dr.gather(mi.UInt32, runs.starts, view_lane)
            view = view_along(triangles, table, rule, lanes.at(view_lane))
            # The unused lanes of the last SIMD packet gather 0, and the CPU traps a division by it.
            row = dr.maximum(dr.gather(mi.UInt32, count_u, view_lane), 1)
            yield Columns(
                view=view,
                face_u=dr.gather(mi.Int32, first_u, view_lane) + mi.Int32(local % row),
                face_v=dr.gather(mi.Int32, first_v, view_lane) + mi.Int32(local // row),
            )


@dataclass
class _Lanes:
    """Candidates of one pass, each seen along three axes: a lane for every view."""

    candidates: Candidates
    start: mi.UInt32
    width: mi.UInt32

    def at(self, lane: mi.UInt32) -> tuple[mi.UInt32, mi.UInt32, mi.UInt32]:
        """Triangle, region and axis of each lane."""
        pair = lane % self.width + self.start
        triangle = dr.gather(mi.UInt32, self.candidates.triangle, pair)
        return triangle, dr.gather(mi.UInt32, self.candidates.region, pair), lane // self.width


def _bounds(
    triangles: DeviceTriangles,
    table: RegionTable,
    rule: SlotRule,
    lanes: tuple[mi.UInt32, mi.UInt32, mi.UInt32],
    search: Search,
) -> tuple[mi.Int32, mi.Int32, mi.UInt32, mi.UInt32]:
    """First face along u and v, faces along u, and faces in all, of each triangle's bounds."""
    view = view_along(triangles, table, rule, lanes)
    _, region, axis = lanes
    factor = mi.Int32(dr.gather(mi.UInt32, table.supersampling, region))

    def face_range(cells: list[mi.Float64], which: mi.UInt32) -> tuple[mi.Int32, mi.Int32]:
        low = factor * (along_axis(table.low, region, which) - search.margin_voxels)
        shape = along_axis(table.shape, region, which) + 2 * search.margin_voxels
        high = low + factor * shape - 1
        least = dr.minimum(dr.minimum(cells[0], cells[1]), cells[2])
        most = dr.maximum(dr.maximum(cells[0], cells[1]), cells[2])
        if not search.has_rim:
            least = dr.ceil(least - 0.5 - EDGE_TOLERANCE)
            most = dr.floor(most - 0.5 + EDGE_TOLERANCE)
        # In double precision until clipped: far triangles overflow an integer.
        first, last = dr.floor(least / CELLS_PER_EDGE), dr.floor(most / CELLS_PER_EDGE)
        first = dr.clip(first, mi.Float64(low), mi.Float64(high) + 1.0)
        last = dr.clip(last, mi.Float64(low) - 1.0, mi.Float64(high))
        return mi.Int32(first), mi.Int32(dr.maximum(last - first + 1.0, 0.0))

    first_u, count_u = face_range(view.u, (axis + 1) % 3)
    first_v, count_v = face_range(view.v, (axis + 2) % 3)
    near, far = filled_depths(view)
    low_layer = along_axis(table.low, region, axis) - search.margin_voxels
    high_layer = low_layer + along_axis(table.shape, region, axis) + 2 * search.margin_voxels
    is_met = (far >= mi.Float64(low_layer)) & (near < mi.Float64(high_layer)) & view.slot.is_facing
    if search.is_dominant_only:
        is_met &= axis == dominant_axis(triangles, view.triangle)
    column_count = dr.select(is_met, mi.UInt32(count_u * count_v), 0)
    # Evaluated together with what is counted.
    dr.schedule(first_u, first_v, count_u, column_count)
    return first_u, first_v, mi.UInt32(count_u), column_count


def dominant_axis(triangles: DeviceTriangles, triangle: mi.UInt32) -> mi.UInt32:
    """Axis along which each triangle has its largest projection; the first of equals."""
    stride = dr.opaque(mi.UInt32, triangles.count)
    x, y, z = (
        dr.abs(dr.gather(mi.Float, triangles.normal, axis * stride + triangle)) for axis in range(3)
    )
    first = dr.select(y > x, mi.UInt32(1), mi.UInt32(0))
    return dr.select(z > dr.maximum(x, y), mi.UInt32(2), first)
