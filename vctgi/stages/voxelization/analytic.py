"""Analytic coverage: the exact share of a voxel's face that triangles cover.

The area of each triangle within each voxel is known in closed form. Areas add, in fixed point so
that the order does not matter, and stop at the whole face: surfaces that overlap, as seen along the
axis within one voxel, count double where the cells of a grid would count them once.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi

from vctgi.stages.voxelization.alpha_masks import has_masks, opacity_test
from vctgi.stages.voxelization.cells import face_layers, face_word
from vctgi.stages.voxelization.clipped_area import clipped_area
from vctgi.stages.voxelization.columns import CELLS_PER_EDGE, Columns, RegionTable
from vctgi.stages.voxelization.depth_plane import DepthPlane, depth_plane
from vctgi.stages.voxelization.triangles import DeviceTriangles

UNIT = 2.0**32
"""One face in fixed point: a face may be covered 2^31 times over before the sum overflows."""


def add_areas(
    sums: mi.Int64, columns: Columns, table: RegionTable, triangles: DeviceTriangles
) -> None:
    """Add the area of triangles to every voxel that they fill, in units of 1 / `UNIT` faces.

    Parameters
    ----------
    sums
        Words of `table`, which must not be supersampled.
    columns
        Where to look.
    table
        Regions to fill.
    triangles
        The triangles. A mask thins an area by the opaque share of what it covers of the face.
    """
    plane = depth_plane(columns.view, columns)
    add_weighed_areas([sums], [opaque_share(columns, plane, triangles)], columns, table)


def add_weighed_areas(
    sums: Sequence[mi.Int64],
    weights: Sequence[mi.Float64],
    columns: Columns,
    table: RegionTable,
) -> None:
    """Add areas as `add_areas` does, to each of several sums with a weight of its own [column]."""
    view = columns.view
    first, last = face_layers(view, table, depth_plane(view, columns), has_rim=True)
    thickness = mi.Float64(view.slot.thickness)
    is_upward = view.slot.behind > 0
    nudge = view.low_depth - dr.minimum(dr.minimum(view.depth[0], view.depth[1]), view.depth[2])
    depth = [corner + nudge for corner in view.depth]
    low_u, low_v = (mi.Float64(face * CELLS_PER_EDGE) for face in (columns.face_u, columns.face_v))
    word = face_word(columns, table)

    def body(layer: mi.Int32) -> tuple[mi.Int32]:
        low = mi.Float64(layer) - dr.select(is_upward, thickness, 0.0)
        high = mi.Float64(layer) + 1.0 + dr.select(is_upward, 0.0, thickness)
        corner = (low_u + CELLS_PER_EDGE, low_v + CELLS_PER_EDGE, high)
        area = clipped_area(view.u, view.v, depth, (low_u, low_v, low), corner)
        for weight, target in zip(weights, sums, strict=True):
            amount = mi.Int64(dr.round(area * weight * (UNIT / CELLS_PER_EDGE**2)))
            # Direct: other modes compile the size of the target into the kernel.
            dr.scatter_reduce(
                dr.ReduceOp.Add, target, amount, word(layer), amount > 0, dr.ReduceMode.Direct
            )
        return (layer + 1,)

    dr.while_loop(
        state=(first,),
        cond=lambda layer: layer <= last,
        body=body,
        labels=("layer",),
        label="add_weighed_areas",
    )


def opaque_share(columns: Columns, plane: DepthPlane, triangles: DeviceTriangles) -> mi.Float64:
    """Share of what a triangle covers of a face at which a mask stops light, cell by cell."""
    if triangles.mask is None:
        return mi.Float64(1.0)
    view = columns.view
    is_opaque, has_mask = opacity_test(columns, plane, triangles), has_masks(columns, triangles)
    low_u, low_v = (mi.Float64(face * CELLS_PER_EDGE) for face in (columns.face_u, columns.face_v))
    none = dr.zeros(mi.Float64, dr.width(columns.face_u))

    def body(
        cell: mi.UInt32, opaque: mi.Float64, total: mi.Float64
    ) -> tuple[mi.UInt32, mi.Float64, mi.Float64]:
        u = low_u + mi.Float64(cell % CELLS_PER_EDGE)
        v = low_v + mi.Float64(cell // CELLS_PER_EDGE)
        low = (u, v, view.low_depth - 1.0)
        high = (u + 1.0, v + 1.0, view.high_depth + 1.0)
        area = clipped_area(view.u, view.v, view.depth, low, high)
        return cell + 1, opaque + dr.select(is_opaque(cell), area, 0.0), total + area

    _, opaque, total = dr.while_loop(
        state=(dr.zeros(mi.UInt32, dr.width(columns.face_u)), none, mi.Float64(none)),
        cond=lambda cell, opaque, total: has_mask & (cell < CELLS_PER_EDGE**2),
        body=body,
        labels=("cell", "opaque", "total"),
        label="opaque_share",
    )
    return dr.select(has_mask, opaque / dr.select(total > 0.0, total, 1.0), 1.0)
