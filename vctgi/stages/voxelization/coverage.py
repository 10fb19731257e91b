"""Coverage of voxel faces by triangles, on a regular sub-grid of each face.

Along each axis a level's window is a square of cells, several to a voxel. A triangle covers the
cells whose centres its projection contains; the plane of the triangle says how deep, and so in
which voxel, each covered cell lies. The result is one bit per cell, so that surfaces which overlap
are counted once and shared edges neither leave cracks nor count double.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import BEHIND_NUDGE, surface_slot
from vctgi.maths.directions import other_axes, random_unit
from vctgi.maths.stub_gaps import as_component

CELLS_PER_EDGE = 8
"""Cells along an edge of a voxel face; their 64 bits fit one word."""

EDGE_TOLERANCE = 1e-6
"""How far outside an edge, in cells, a centre still counts as covered: shared edges that rounding
moves apart leave no cracks, and a bit set twice is set once."""

CELLS_PER_PASS = 1 << 23
"""Candidate cells that are tested at a time; bounds the memory of a pass."""


@dataclass
class DeviceTriangles:
    """Triangles to voxelize on the device, in double precision.

    Attributes
    ----------
    corners
        Three world points, [corner] of (x, y, z).
    uv
        Three texture coordinates.
    normal
        Unit geometric normals.
    count
        Number of triangles.
    mask
        BSDF whose null transmission thins the coverage, or None for opaque triangles.
    """

    corners: list[list[mi.Float64]]
    uv: list[mi.Point2f]
    normal: list[mi.Float]
    count: int
    mask: mi.BSDF | None


@dataclass
class _Projection:
    """Triangles seen along one axis, in cells from the window's corner."""

    corner_u: list[mi.Float64]
    corner_v: list[mi.Float64]
    depth: list[mi.Float64]  # in voxels
    first_u: mi.Int32
    first_v: mi.Int32
    count_u: mi.UInt32
    cell_count: mi.UInt32


def coverage_masks(triangles: list[DeviceTriangles], level: LevelLayout, axis: int) -> mi.UInt64:
    """Return the covered cells of all voxel faces across one axis.

    Parameters
    ----------
    triangles
        What to voxelize.
    level
        Window to fill.
    axis
        0, 1 or 2: the axis along which faces are seen.

    Returns
    -------
    mi.UInt64
        Flat [side, z, y, x] with texels at their toroidal address; bit `CELLS_PER_EDGE * v + u` is
        the cell (u, v) of the two axes across, in cyclic order.
    """
    masks = dr.zeros(mi.UInt64, 2 * level.voxel_count)
    for batch in triangles:
        projection = _project(batch, level, axis)
        is_met = projection.cell_count > 0
        met = mi.UInt32(dr.compress(is_met))
        if dr.width(met) == 0:
            continue
        counts = dr.gather(mi.UInt32, projection.cell_count, met)
        starts = dr.prefix_sum(counts)
        dr.eval(starts)
        # Wide sums: a scene may ask for more cells than 32 bits count.
        total = int(dr.sum(mi.UInt64(counts))[0])
        if total >= 2**32:
            raise ValueError(
                f"coverage_masks: level {level.level} needs {total} cells along axis {axis}; "
                "lower the clipmap's resolution."
            )
        for begin in range(0, total, CELLS_PER_PASS):
            end = min(begin + CELLS_PER_PASS, total)
            owner = _owners(starts, begin, end)
            cell = dr.arange(mi.UInt32, end - begin) + begin
            local = cell - dr.gather(mi.UInt32, starts, owner)
            triangle = dr.gather(mi.UInt32, met, owner)
            _mark_cells(masks, batch, projection, triangle, local, level, axis)
            dr.eval(masks)
    return masks


def _project(batch: DeviceTriangles, level: LevelLayout, axis: int) -> _Projection:
    """See triangles along an axis and count the cells that their bounds contain."""
    u, v = other_axes(axis)
    per_voxel = 1.0 / level.voxel_size
    window = level.resolution * CELLS_PER_EDGE

    def in_voxels(corner: int, along: int) -> mi.Float64:
        return batch.corners[corner][along] * per_voxel - float(level.origin[along])

    corner_u = [in_voxels(corner, u) * CELLS_PER_EDGE for corner in range(3)]
    corner_v = [in_voxels(corner, v) * CELLS_PER_EDGE for corner in range(3)]
    depth = [in_voxels(corner, axis) for corner in range(3)]

    def cell_range(corners: list[mi.Float64]) -> tuple[mi.Int32, mi.Int32]:
        low = dr.minimum(dr.minimum(corners[0], corners[1]), corners[2])
        high = dr.maximum(dr.maximum(corners[0], corners[1]), corners[2])
        # In double precision before the clip: far triangles overflow an integer.
        first = dr.clip(dr.ceil(low - 0.5 - EDGE_TOLERANCE), 0.0, float(window))
        last = dr.clip(dr.floor(high - 0.5 + EDGE_TOLERANCE), -1.0, float(window - 1))
        return mi.Int32(first), mi.Int32(dr.maximum(last - first + 1.0, 0.0))

    first_u, count_u = cell_range(corner_u)
    first_v, count_v = cell_range(corner_v)
    near = dr.minimum(dr.minimum(depth[0], depth[1]), depth[2])
    far = dr.maximum(dr.maximum(depth[0], depth[1]), depth[2])
    # Sloped surfaces reach one voxel behind themselves.
    is_held = (far >= -1.0) & (near <= level.resolution + 1.0) & (batch.normal[axis] != 0.0)
    cell_count = dr.select(is_held, mi.UInt32(count_u * count_v), 0)
    dr.eval(corner_u, corner_v, depth, first_u, first_v, count_u, cell_count)
    return _Projection(corner_u, corner_v, depth, first_u, first_v, mi.UInt32(count_u), cell_count)


def _owners(starts: mi.UInt32, begin: int, end: int) -> mi.UInt32:
    """Which run each number in [begin, end) belongs to; runs are not empty."""
    before = int(mi.UInt32(dr.count(starts <= begin))[0]) - 1
    is_new = dr.zeros(mi.UInt32, end - begin)
    dr.scatter(is_new, mi.UInt32(1), starts - begin, (starts > begin) & (starts < end))
    return before + dr.cumsum(is_new)


def _mark_cells(
    masks: mi.UInt64,
    batch: DeviceTriangles,
    projection: _Projection,
    triangle: mi.UInt32,
    local: mi.UInt32,
    level: LevelLayout,
    axis: int,
) -> None:
    """Set the bits of the candidate cells that their triangle covers."""

    def of_triangle(values: list[mi.Float64]) -> list[mi.Float64]:
        return [dr.gather(mi.Float64, value, triangle) for value in values]

    # The unused lanes of the last SIMD packet gather 0, and the CPU traps a division by it.
    row = dr.maximum(dr.gather(mi.UInt32, projection.count_u, triangle), 1)
    cell_u = dr.gather(mi.Int32, projection.first_u, triangle) + mi.Int32(local % row)
    cell_v = dr.gather(mi.Int32, projection.first_v, triangle) + mi.Int32(local // row)
    inside, share = _barycentric(
        of_triangle(projection.corner_u),
        of_triangle(projection.corner_v),
        mi.Float64(cell_u) + 0.5,
        mi.Float64(cell_v) + 0.5,
    )
    depth = sum(s * d for s, d in zip(share, of_triangle(projection.depth), strict=True))

    slot = surface_slot(dr.gather(mi.Float, batch.normal[axis], triangle))
    if batch.mask is not None:
        uv = sum(
            (
                as_component(mi.Float(s)) * dr.gather(mi.Point2f, corner, triangle)
                for s, corner in zip(share, batch.uv, strict=True)
            ),
            mi.Point2f(0.0),
        )
        inside &= _is_opaque(batch.mask, uv, cell_u, cell_v, mi.Int32(dr.floor(depth)))

    voxel = mi.Int32(dr.floor(depth + mi.Float64(slot.behind) * BEHIND_NUDGE))
    bit_index = mi.UInt32(cell_v % CELLS_PER_EDGE) * CELLS_PER_EDGE + mi.UInt32(
        cell_u % CELLS_PER_EDGE
    )
    bit = mi.UInt64(1) << mi.UInt64(bit_index)
    _set(masks, bit, (voxel, cell_u, cell_v), slot.side, inside, level, axis)
    behind = voxel + slot.behind
    _set(masks, bit, (behind, cell_u, cell_v), slot.side, inside & slot.is_sloped, level, axis)


def _barycentric(
    u: list[mi.Float64], v: list[mi.Float64], centre_u: mi.Float64, centre_v: mi.Float64
) -> tuple[mi.Bool, list[mi.Float64]]:
    """Whether cell centres lie in their triangles, and their barycentric coordinates."""
    doubled = (u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0])
    inside = doubled != 0.0
    share = []
    for corner in range(3):
        a, b = (corner + 1) % 3, (corner + 2) % 3
        edge_u, edge_v = u[b] - u[a], v[b] - v[a]
        cross = edge_u * (centre_v - v[a]) - edge_v * (centre_u - u[a])
        length = dr.sqrt(edge_u * edge_u + edge_v * edge_v)
        signed: mi.Float64 = dr.mulsign(cross, doubled)  # type: ignore[no-untyped-call]
        inside &= signed >= -EDGE_TOLERANCE * length
        share.append(cross / doubled)
    return inside, share


def _is_opaque(
    bsdf: mi.BSDF, uv: mi.Point2f, cell_u: mi.Int32, cell_v: mi.Int32, voxel: mi.Int32
) -> mi.Bool:
    """Whether an alpha mask stops light at a cell, dithered so that the mean is its opacity."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(uv))
    si.uv = uv
    si.wi = mi.Vector3f(0.0, 0.0, 1.0)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    passed = dr.mean(mi.Color3f(bsdf.eval_null_transmission(si)))
    threshold = random_unit(
        mi.UInt32(cell_u) + 0x9E3779B9 * mi.UInt32(cell_v) + 0x85EBCA6B * mi.UInt32(voxel), 0
    )
    return passed <= threshold


def _set(
    masks: mi.UInt64,
    bit: mi.UInt64,
    cell: tuple[mi.Int32, mi.Int32, mi.Int32],
    side: mi.UInt32,
    active: mi.Bool,
    level: LevelLayout,
    axis: int,
) -> None:
    """Set a bit of the voxel that holds a cell, given as (depth in voxels, cells u and v)."""
    u, v = other_axes(axis)
    depth, cell_u, cell_v = cell
    local = [mi.Int32(0)] * 3
    local[axis], local[u], local[v] = depth, cell_u // CELLS_PER_EDGE, cell_v // CELLS_PER_EDGE
    active = active & (depth >= 0) & (depth < level.resolution)
    voxel = mi.Vector3i(local) + mi.Vector3i(*level.origin)
    index = texel_from_voxel(voxel, level.resolution) + side * level.voxel_count
    dr.scatter_reduce(dr.ReduceOp.Or, masks, bit, index, active)
