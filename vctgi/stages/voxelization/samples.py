"""Coverage by the eight samples of standard multisampling: the talk's own algorithm.

A triangle is seen along its axis of largest projected area alone, where its depth changes by no
more than one cell from cell to cell. The eight samples are centres of cells of the face, one in
each block of 2 x 4 cells; a covered one stands for its block, which is how the irregular pattern is
moved onto a regular sub-grid. The block goes where the triangle's plane takes it: into its layer of
voxels along that axis, and as a parallelogram onto the faces across the other two. No sample gets
lost there: seen nearly edge-on it still sets one cell in each row, and it falls into the nearer or
farther voxel as the slope has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slots import BEHIND_NUDGE, SlotRule, SurfaceSlot
from vctgi.stages.voxelization.alpha_masks import opaque_cells
from vctgi.stages.voxelization.cells import covered_cells, face_word
from vctgi.stages.voxelization.columns import (
    CELLS_PER_EDGE,
    EDGE_TOLERANCE,
    Columns,
    FaceView,
    RegionTable,
    Search,
    along_axis,
    view_along,
)
from vctgi.stages.voxelization.depth_plane import depth_plane
from vctgi.stages.voxelization.triangles import DeviceTriangles

STANDARD_PATTERN = ((1, -3), (-1, 3), (5, 1), (-3, -5), (-5, 5), (-7, -1), (3, 7), (7, -7))
"""The standard pattern of eight samples, in sixteenths of a face from its centre. [Direct3D11]"""

SAMPLE_CELLS = tuple(((u + 7) // 2, (v + 7) // 2) for u, v in STANDARD_PATTERN)
"""Cells (u, v) of a face whose centres these are."""

BLOCK_CELLS = (2, 4)
"""Cells along u and v of the block that a sample stands for."""

FIRST_COLUMN = 0x0101010101010101
"""The first cell of every row of a face."""


@dataclass
class Block:
    """The cells that a sample stands for, a lane for each column.

    Attributes
    ----------
    low
        First cell along u and v of the face; the same in all lanes.
    is_covered
        Whether the triangle covers the sample.
    depth
        Depth of the triangle's plane at the block's centre, a little behind the surface, in cells.
    """

    low: tuple[int, int]
    is_covered: mi.Bool
    depth: mi.Float64

    @property
    def bits(self) -> int:
        """Cells of the block on its own face."""
        u, v = self.low
        row = ((1 << BLOCK_CELLS[0]) - 1) << u
        return sum(row << (CELLS_PER_EDGE * (v + step)) for step in range(BLOCK_CELLS[1]))


@dataclass
class SampledFaces:
    """What the samples of a triangle say about faces across its dominant axis.

    Attributes
    ----------
    columns
        The faces, a lane each.
    cells
        Cells along the edge of a voxel.
    blocks
        One for each sample.
    slopes
        What the depth gains along u and v, in cells per cell, -1 .. 1.
    """

    columns: Columns
    cells: mi.Float64
    blocks: list[Block]
    slopes: tuple[mi.Float64, mi.Float64]

    def depths(self) -> tuple[mi.Float64, mi.Float64]:
        """Least and largest depth of the covered blocks' centres, in cells."""
        least, most = mi.Float64(dr.inf), mi.Float64(-dr.inf)
        for block in self.blocks:
            least = dr.select(block.is_covered, dr.minimum(least, block.depth), least)
            most = dr.select(block.is_covered, dr.maximum(most, block.depth), most)
        return least, most


def sample_search(rule: SlotRule) -> Search:
    """Return which columns may set bits in a region.

    Across the dominant axis a surface is thickened out of its column by no more voxels than the
    thickness, rounded up; along it a block reaches less than half a voxel beyond the triangle.
    """
    return Search(is_dominant_only=True, margin_voxels=max(1, math.ceil(rule.thickness_voxels)))


def mark_samples(
    masks: mi.UInt64,
    columns: Columns,
    table: RegionTable,
    rule: SlotRule,
    triangles: DeviceTriangles,
) -> None:
    """Set the bits of the blocks of covered samples, along all three axes.

    Parameters
    ----------
    masks
        Words of `table`; bit `CELLS_PER_EDGE * v + u` is cell (u, v) of a sub-face.
    columns
        Columns along each triangle's dominant axis, found by `sample_search`. They may lie outside
        their regions; only bits within are set.
    table
        Regions to fill.
    rule
        How thick surfaces are made.
    triangles
        The triangles; their mask thins the coverage.

    References
    ----------
    [Panteleev2014], slides "Voxelization for opacity"; the pattern is that of [Direct3D11].
    """
    faces = sample_faces(columns, table, triangles)
    _mark_dominant(masks, faces, table)
    view = columns.view
    for turn in (1, 2):
        lanes = (view.triangle, view.region, (view.axis + turn) % 3)
        _mark_side(masks, faces, table, view_along(triangles, table, rule, lanes), turn)


def sample_faces(columns: Columns, table: RegionTable, triangles: DeviceTriangles) -> SampledFaces:
    """Test the samples of faces, and move them to the centres of their blocks."""
    view = columns.view
    plane = depth_plane(view, columns)
    covered = covered_cells(view, columns) & sum(1 << _bit(u, v) for u, v in SAMPLE_CELLS)
    if triangles.mask is not None:
        covered = opaque_cells(covered, columns, plane, triangles)
    factor = dr.gather(mi.UInt32, table.supersampling, view.region)
    cells = mi.Float64(factor * CELLS_PER_EDGE)
    # Along a dominant axis slopes are at most one; those of needles round to anything.
    slope_u, slope_v = (
        dr.clip(slope * cells, -1.0, 1.0) for slope in (plane.slope_u, plane.slope_v)
    )
    blocks = []
    for u, v in SAMPLE_CELLS:
        low_u, low_v = u - u % BLOCK_CELLS[0], v - v % BLOCK_CELLS[1]
        depth = plane.corner + plane.slope_u * float(u) + plane.slope_v * float(v)
        # A sample at the rim may lie outside the triangle by the tolerance; its depth does not.
        depth = cells * dr.clip(depth, view.low_depth, view.high_depth)
        depth += slope_u * (low_u + 0.5 * (BLOCK_CELLS[0] - 1) - u)
        depth += slope_v * (low_v + 0.5 * (BLOCK_CELLS[1] - 1) - v)
        is_covered = (covered & (1 << _bit(u, v))) != 0
        blocks.append(Block((low_u, low_v), is_covered, depth))
    return SampledFaces(columns, cells, blocks, (slope_u, slope_v))


def _bit(u: int, v: int) -> int:
    """Return the bit of a cell in the word of its face."""
    return CELLS_PER_EDGE * v + u


def _mark_dominant(masks: mi.UInt64, faces: SampledFaces, table: RegionTable) -> None:
    """Set blocks in the layers of voxels along the dominant axis."""
    columns, blocks = faces.columns, faces.blocks
    view = columns.view
    thickness = mi.Float64(view.slot.thickness)
    is_upward = view.slot.behind > 0
    to_low, to_high = dr.select(is_upward, 0.0, thickness), dr.select(is_upward, thickness, 0.0)
    per_cell = 1.0 / faces.cells
    least, most = faces.depths()
    lowest, highest = _bounds(table, view.region, view.axis)
    # In double precision until clipped: far triangles overflow an integer.
    first = mi.Int32(dr.clip(dr.floor(least * per_cell - to_low), lowest, highest + 1.0))
    last = mi.Int32(dr.clip(dr.floor(most * per_cell + to_high), lowest - 1.0, highest))
    is_inside = _is_within(table, view.region, (view.axis + 1) % 3, columns.face_u)
    is_inside &= _is_within(table, view.region, (view.axis + 2) % 3, columns.face_v)
    word = face_word(columns, table)

    def body(layer: mi.Int32) -> tuple[mi.Int32]:
        floor = mi.Float64(layer)
        bits = mi.UInt64(0)
        for block in blocks:
            depth = block.depth * per_cell
            is_met = (depth + to_high >= floor) & (depth - to_low < floor + 1.0)
            bits |= dr.select(block.is_covered & is_met, mi.UInt64(block.bits), 0)
        # Direct: other modes compile the size of the target into the kernel.
        dr.scatter_reduce(dr.ReduceOp.Or, masks, bits, word(layer), bits != 0, dr.ReduceMode.Direct)
        return (layer + 1,)

    dr.while_loop(
        state=(dr.select(is_inside, first, last + 1),),
        cond=lambda layer: layer <= last,
        body=body,
        labels=("layer",),
        label="mark_dominant",
    )


def _mark_side(
    masks: mi.UInt64, faces: SampledFaces, table: RegionTable, side: FaceView, turn: int
) -> None:
    """Set the blocks' parallelograms on the faces across an axis that is not the dominant one.

    `side` is the triangle seen along that axis, which is u for `turn` 1 and v for 2. Faces across u
    are (v, depth), those across v are (depth, u).
    """
    columns, blocks, region = faces.columns, faces.blocks, faces.columns.view.region
    axis = columns.view.axis
    along, lateral = columns.face_u, columns.face_v
    if turn == 2:
        along, lateral = lateral, along
    factor = dr.gather(mi.UInt32, table.supersampling, region)
    layer = along >> mi.Int32(dr.log2i(factor))
    is_inside = side.slot.is_facing & _is_within(table, region, (axis + 3 - turn) % 3, lateral)
    lowest_layer, highest_layer = _bounds(table, region, side.axis)
    lowest, highest = _bounds(table, region, axis)
    scale = mi.Float64(factor)
    lowest, highest = lowest * scale, (highest + 1.0) * scale - 1.0
    least, most = faces.depths()
    reach = mi.Float64(0.0)
    for slope, size in zip(faces.slopes, BLOCK_CELLS, strict=True):
        reach += 0.5 * size * dr.abs(slope)
    first = mi.Int32(dr.clip(dr.floor((least - reach) / CELLS_PER_EDGE), lowest, highest + 1.0))
    last = mi.Int32(dr.clip(dr.floor((most + reach) / CELLS_PER_EDGE), lowest - 1.0, highest))

    def body(depth_face: mi.Int32) -> tuple[mi.Int32]:
        seen = (lateral, depth_face) if turn == 1 else (depth_face, lateral)
        word = face_word(Columns(side, *seen), table)
        shapes = [_parallelogram(faces, block, turn, depth_face) for block in blocks]
        for step in range(math.ceil(side.slot.max_thickness) + 1):
            target = layer + step * side.slot.behind
            bits = mi.UInt64(0)
            for block, shape in zip(blocks, shapes, strict=True):
                low = along * CELLS_PER_EDGE + block.low[turn - 1]
                centre = (mi.Float64(low) + 0.5 * BLOCK_CELLS[turn - 1]) / faces.cells
                is_met = block.is_covered & (_layers_behind(centre, side.slot) >= step)
                bits |= dr.select(is_met, shape, 0)
            is_set = (bits != 0) & _is_between(target, lowest_layer, highest_layer)
            dr.scatter_reduce(
                dr.ReduceOp.Or, masks, bits, word(target), is_set, dr.ReduceMode.Direct
            )
        return (depth_face + 1,)

    dr.while_loop(
        state=(dr.select(is_inside, first, last + 1),),
        cond=lambda depth_face: depth_face <= last,
        body=body,
        labels=("depth_face",),
        label="mark_side",
    )


def _parallelogram(faces: SampledFaces, block: Block, turn: int, depth_face: mi.Int32) -> mi.UInt64:
    """Cells of a face across u or v that a block fills: an interval of depths in each row."""
    along, lateral = turn - 1, 2 - turn
    half = 0.5 * BLOCK_CELLS[along] * dr.abs(faces.slopes[along])
    origin = mi.Float64(depth_face * CELLS_PER_EDGE)
    bits = mi.UInt64(0)
    for row in range(BLOCK_CELLS[lateral]):
        middle = block.depth + faces.slopes[lateral] * (row - 0.5 * (BLOCK_CELLS[lateral] - 1))
        first = dr.ceil(middle - half - 0.5 - EDGE_TOLERANCE)
        last = dr.floor(middle + half - 0.5 + EDGE_TOLERANCE)
        # Too narrow to hold the centre of a cell, it is blurred to the cell that it lies in.
        is_narrow = last < first
        first = dr.select(is_narrow, dr.floor(middle), first)
        last = dr.select(is_narrow, first, last)
        begin, after = (
            mi.UInt64(mi.UInt32(dr.clip(cell - origin, 0.0, float(CELLS_PER_EDGE))))
            for cell in (first, last + 1.0)
        )
        cell = block.low[lateral] + row
        if turn == 1:
            bits |= (_rows_before(after) - _rows_before(begin)) & (FIRST_COLUMN << cell)
        else:
            bits |= ((mi.UInt64(1) << after) - (mi.UInt64(1) << begin)) << (CELLS_PER_EDGE * cell)
    return bits


def _rows_before(row: mi.UInt64) -> mi.UInt64:
    """Return the number after the bits of the rows before `row`; a wrapped 0 after all eight."""
    half = row * (CELLS_PER_EDGE // 2)
    return (mi.UInt64(1) << half) << half


def _layers_behind(place: mi.Float64, slot: SurfaceSlot) -> mi.Int32:
    """How many layers of voxels behind its own a surface at `place`, in voxels, is thickened to."""
    behind = mi.Float64(slot.behind)
    begin = place + behind * BEHIND_NUDGE
    end = begin + behind * mi.Float64(slot.thickness)
    return dr.abs(mi.Int32(dr.floor(end) - dr.floor(begin)))


def _bounds(
    table: RegionTable, region: mi.UInt32, axis: mi.UInt32
) -> tuple[mi.Float64, mi.Float64]:
    """First and last voxel of a region along an axis."""
    low = along_axis(table.low, region, axis)
    high = low + along_axis(table.shape, region, axis) - 1
    return mi.Float64(low), mi.Float64(high)


def _is_within(table: RegionTable, region: mi.UInt32, axis: mi.UInt32, face: mi.Int32) -> mi.Bool:
    """Whether a (sub-)face lies in a region, along an axis."""
    shift = dr.log2i(dr.gather(mi.UInt32, table.supersampling, region))
    return _is_between(face >> mi.Int32(shift), *_bounds(table, region, axis))


def _is_between(voxel: mi.Int32, lowest: mi.Float64, highest: mi.Float64) -> mi.Bool:
    return (mi.Float64(voxel) >= lowest) & (mi.Float64(voxel) <= highest)
