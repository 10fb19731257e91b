"""Covered cells: the 64 cells of a face that a triangle covers, as the bits of one word.

Each row of a face is cut by an edge at one place, so the covered cells of a row are an interval and
a triangle's cells are found row by row instead of cell by cell. Depth is linear across the face, so
the cells that lie in one layer of voxels are found in the same way.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi

from vctgi.stages.voxelization.alpha_masks import opaque_cells
from vctgi.stages.voxelization.columns import (
    CELLS_PER_EDGE,
    EDGE_TOLERANCE,
    Columns,
    FaceView,
    RegionTable,
    along_axis,
    filled_depths,
)
from vctgi.stages.voxelization.depth_plane import DepthPlane, depth_plane
from vctgi.stages.voxelization.triangles import DeviceTriangles

PARALLEL_EDGE = 1e-14
"""An edge that rises less than this share of its length runs along the rows."""

FLAT_SLOPE = 1e-12
"""A slope along a row, in voxels per cell, below which the row has one depth."""

ROW = (1 << CELLS_PER_EDGE) - 1
"""All cells of a row."""


def mark_cells(
    masks: mi.UInt64, columns: Columns, table: RegionTable, triangles: DeviceTriangles
) -> None:
    """Set the bits of the cells that triangles cover, in every layer of voxels that they fill.

    Parameters
    ----------
    masks
        Words of `table`; bit `CELLS_PER_EDGE * v + u` is cell (u, v) of a sub-face.
    columns
        Where to look.
    table
        Regions to fill.
    triangles
        The triangles; their mask thins the coverage.
    """
    view = columns.view
    plane = depth_plane(view, columns)
    covered = covered_cells(view, columns)
    if triangles.mask is not None:
        covered = opaque_cells(covered, columns, plane, triangles)
    first, last = face_layers(view, table, plane)
    thickness = mi.Float64(view.slot.thickness)
    is_upward = view.slot.behind > 0
    word = face_word(columns, table)

    def body(layer: mi.Int32) -> tuple[mi.Int32]:
        low = mi.Float64(layer) - dr.select(is_upward, thickness, 0.0)
        high = mi.Float64(layer) + 1.0 + dr.select(is_upward, 0.0, thickness)
        # Cells at the rim may lie outside the triangle by the tolerance; their depth does not.
        above = cells_at_or_above(plane, low) | dr.select(view.low_depth >= low, _all_cells(), 0)
        below = ~cells_at_or_above(plane, high) | dr.select(view.high_depth < high, _all_cells(), 0)
        bits = covered & above & below
        # Direct: other modes compile the size of the target into the kernel.
        dr.scatter_reduce(dr.ReduceOp.Or, masks, bits, word(layer), bits != 0, dr.ReduceMode.Direct)
        return (layer + 1,)

    is_covered = covered != 0
    dr.while_loop(
        state=(dr.select(is_covered, first, last + 1),),
        cond=lambda layer: layer <= last,
        body=body,
        labels=("layer",),
        label="mark_cells",
    )


def _all_cells() -> mi.UInt64:
    """Return a word with every cell set."""
    return mi.UInt64(2**64 - 1)


def face_layers(
    view: FaceView, table: RegionTable, plane: DepthPlane, *, has_rim: bool = False
) -> tuple[mi.Int32, mi.Int32]:
    """First and last layer of voxels of the region that a face may fill.

    By its cells' centres, or with the half cell around them (`has_rim`).
    """
    reach = float(CELLS_PER_EDGE - 1)
    near = plane.corner + reach * (dr.minimum(plane.slope_u, 0.0) + dr.minimum(plane.slope_v, 0.0))
    far = plane.corner + reach * (dr.maximum(plane.slope_u, 0.0) + dr.maximum(plane.slope_v, 0.0))
    if has_rim:
        rim = 0.5 * (dr.abs(plane.slope_u) + dr.abs(plane.slope_v))
        near, far = near - rim, far + rim
    low, high = filled_depths(view)
    near = dr.maximum(near - (view.low_depth - low), low)
    far = dr.minimum(far + (high - view.high_depth), high)
    lowest = along_axis(table.low, view.region, view.axis)
    highest = lowest + along_axis(table.shape, view.region, view.axis) - 1
    # In double precision until clipped: far triangles overflow an integer.
    first = dr.clip(dr.floor(near), mi.Float64(lowest), mi.Float64(highest) + 1.0)
    last = dr.clip(dr.floor(far), mi.Float64(lowest) - 1.0, mi.Float64(highest))
    return mi.Int32(first), mi.Int32(last)


def covered_cells(view: FaceView, columns: Columns) -> mi.UInt64:
    """Return the cells whose centres a triangle's projection contains."""
    u, v = (
        [corner - (mi.Float64(face * CELLS_PER_EDGE) + 0.5) for corner in corners]
        for face, corners in ((columns.face_u, view.u), (columns.face_v, view.v))
    )
    doubled = (u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0])
    edges = [_Edge(u, v, corner, doubled) for corner in range(3)]
    bits = mi.UInt64(0)
    for row in range(CELLS_PER_EDGE):
        first, last = mi.Float64(0.0), mi.Float64(CELLS_PER_EDGE - 1.0)
        is_met = doubled != 0.0
        for edge in edges:
            first, last, is_met = edge.cut(row, first, last, is_met)
        bits |= mi.UInt64(dr.select(is_met, _interval(first, last), 0)) << (row * CELLS_PER_EDGE)
    return bits


class _Edge:
    """One edge of a triangle, in cells from the centre of the face's first cell."""

    def __init__(
        self, u: list[mi.Float64], v: list[mi.Float64], corner: int, doubled: mi.Float64
    ) -> None:
        a, b = corner, (corner + 1) % 3
        sign = dr.select(doubled < 0.0, mi.Float64(-1.0), mi.Float64(1.0))
        self.start_u, self.start_v = u[a], v[a]
        self.along_u, self.along_v = sign * (u[b] - u[a]), sign * (v[b] - v[a])
        length = dr.sqrt(self.along_u * self.along_u + self.along_v * self.along_v)
        self.tolerance = EDGE_TOLERANCE * length
        self.is_level = dr.abs(self.along_v) <= PARALLEL_EDGE * length
        self.per_rise = 1.0 / dr.select(self.is_level, 1.0, self.along_v)

    def cut(
        self, row: int, first: mi.Float64, last: mi.Float64, is_met: mi.Bool
    ) -> tuple[mi.Float64, mi.Float64, mi.Bool]:
        """Keep the cells of a row that lie inside the edge or less than the tolerance outside."""
        height = self.along_u * (row - self.start_v) + self.tolerance
        crossing = dr.fma(height, self.per_rise, self.start_u)
        rises, falls = ~self.is_level & (self.along_v > 0.0), ~self.is_level & (self.along_v < 0.0)
        first = dr.select(falls, dr.maximum(first, dr.ceil(crossing)), first)
        last = dr.select(rises, dr.minimum(last, dr.floor(crossing)), last)
        return first, last, is_met & (~self.is_level | (height >= 0.0))


def _interval(first: mi.Float64, last: mi.Float64) -> mi.UInt32:
    """Bits `first` to `last` of a row."""
    begin = mi.UInt32(dr.clip(first, 0.0, float(CELLS_PER_EDGE)))
    after = mi.UInt32(dr.clip(last + 1.0, 0.0, float(CELLS_PER_EDGE)))
    return (mi.UInt32(ROW) << begin) & (mi.UInt32(ROW) >> (CELLS_PER_EDGE - after))


def cells_at_or_above(plane: DepthPlane, depth: mi.Float64) -> mi.UInt64:
    """Return the cells of a face whose depth is `depth` or more."""
    is_flat = dr.abs(plane.slope_u) < FLAT_SLOPE
    per_slope = 1.0 / dr.select(is_flat, 1.0, plane.slope_u)
    bits = mi.UInt64(0)
    for row in range(CELLS_PER_EDGE):
        missing = depth - dr.fma(mi.Float64(row), plane.slope_v, plane.corner)
        crossing = missing * per_slope
        end = float(CELLS_PER_EDGE)
        rising = mi.UInt32(ROW) << mi.UInt32(dr.clip(dr.ceil(crossing), 0.0, end))
        after = mi.UInt32(dr.clip(dr.floor(crossing) + 1.0, 0.0, end))
        falling = mi.UInt32(ROW) >> (CELLS_PER_EDGE - after)
        sloped = dr.select(plane.slope_u > 0.0, rising & ROW, falling)
        level = dr.select(missing <= 0.0, mi.UInt32(ROW), 0)
        bits |= mi.UInt64(dr.select(is_flat, level, sloped)) << (row * CELLS_PER_EDGE)
    return bits


def face_word(columns: Columns, table: RegionTable) -> Callable[[mi.Int32], mi.UInt32]:
    """Return the function that gives the word of a column's face in a layer of voxels."""
    view = columns.view
    region, axis = view.region, view.axis
    factor = dr.gather(mi.UInt32, table.supersampling, region)
    shift = dr.log2i(factor)
    shape = [along_axis(table.shape, region, mi.UInt32(which)) for which in range(2)]
    strides = [mi.Int32(1), shape[0], shape[0] * shape[1]]

    def stride(which: mi.UInt32) -> mi.Int32:
        return dr.select(which == 0, strides[0], dr.select(which == 1, strides[1], strides[2]))

    across = [(axis + 1) % 3, (axis + 2) % 3]
    place = mi.Int32(0)
    sub_face = mi.UInt32(0)
    for which, face in zip(reversed(across), (columns.face_v, columns.face_u), strict=True):
        voxel = (face >> mi.Int32(shift)) - along_axis(table.low, region, which)
        place += voxel * stride(which)
        sub_face = (sub_face << shift) + (mi.UInt32(face) & (factor - 1))
    slot = 2 * axis + view.slot.side
    list_count = dr.gather(mi.UInt32, table.list_count, region)
    base = dr.gather(mi.UInt32, table.offset, region) + mi.UInt32(place)
    base += ((slot << (2 * shift)) + sub_face) * list_count
    base += dr.gather(mi.UInt32, table.first_voxel, region)
    along = stride(axis)
    lowest = along_axis(table.low, region, axis)
    return lambda layer: base + mi.UInt32((layer - lowest) * along)
