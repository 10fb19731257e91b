"""The areas of analytic coverage once more, in numbers that have derivatives.

Areas are summed as integers, which have none; here each face that a triangle may fill in a layer of
voxels is a lane, and `clipped_area` has derivatives by the triangle's corners and by how far the
surface is thickened. Differentiated is what happens inside a voxel. What is not, because it changes
in jumps: which side of which axis a triangle is on, whether it is sloped against an axis, a wall
that faces an axis and passes from one layer of voxels to the next, and what masks let through.
"""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slots import SlotRule
from vctgi.stages.voxelization.analytic import opaque_share
from vctgi.stages.voxelization.cells import face_layers, face_word
from vctgi.stages.voxelization.clipped_area import clipped_area
from vctgi.stages.voxelization.columns import (
    CELLS_PER_EDGE,
    Columns,
    RegionTable,
    Search,
    enumerate_columns,
    view_along,
)
from vctgi.stages.voxelization.depth_plane import depth_plane
from vctgi.stages.voxelization.runs import lay_out_runs, owners
from vctgi.stages.voxelization.triangles import DeviceTriangles


def has_derivatives(triangles: DeviceTriangles, thickness: mi.Float | None) -> bool:
    """Whether what areas follow from has derivatives."""
    return bool(dr.grad_enabled(triangles.corners, thickness))


def without_derivatives(triangles: DeviceTriangles) -> DeviceTriangles:
    """Return the same triangles without derivatives."""
    return replace(triangles, corners=[dr.detach(corner) for corner in triangles.corners])


def mirror_areas(
    triangles: DeviceTriangles, table: RegionTable, rule: SlotRule, thickness: mi.Float | None
) -> mi.Float64:
    """Return the sums of `analytic.add_areas`, in faces, with derivatives.

    Parameters
    ----------
    triangles
        The triangles, whose corners may have derivatives.
    table
        Regions to fill.
    rule
        How thick surfaces are made.
    thickness
        The thickness that `rule` has, with derivatives; None: without.
    """
    sums = dr.zeros(mi.Float64, table.word_count)
    plain = without_derivatives(triangles)
    for columns in enumerate_columns(plain, table, rule, Search(has_rim=True)):
        plane = depth_plane(columns.view, columns)
        opaque = opaque_share(columns, plane, plain) + dr.zeros(
            mi.Float64, dr.width(columns.face_u)
        )
        first, last = face_layers(columns.view, table, plane, has_rim=True)
        runs = lay_out_runs(mi.UInt32(dr.maximum(last - first + 1, 0)))
        if runs is None:
            raise ValueError(
                "mirror_areas: derivatives of more faces than 32 bits count; lower the clipmap's "
                "resolution."
            )
        if runs.total == 0:
            continue
        dr.eval(first, opaque, columns.face_u, columns.face_v)
        column = owners(runs, 0, runs.total)
        step = dr.arange(mi.UInt32, runs.total) - dr.gather(mi.UInt32, runs.starts, column)
        layer = dr.gather(mi.Int32, first, column) + mi.Int32(step)
        area, word = _areas(triangles, table, rule, thickness, (columns, column, layer))
        weight = dr.gather(mi.Float64, opaque, column) / CELLS_PER_EDGE**2
        dr.scatter_reduce(dr.ReduceOp.Add, sums, area * weight, word, dr.detach(area) > 0.0)
    return sums


def _areas(
    triangles: DeviceTriangles,
    table: RegionTable,
    rule: SlotRule,
    thickness: mi.Float | None,
    lanes: tuple[Columns, mi.UInt32, mi.Int32],
) -> tuple[mi.Float64, mi.UInt32]:
    """Area of each lane's triangle in one layer of its column, in cells, and where it is summed."""
    columns, column, layer = lanes
    seen = (columns.view.triangle, columns.view.region, columns.view.axis)
    triangle, region, axis = (dr.gather(mi.UInt32, each, column) for each in seen)
    view = view_along(triangles, table, rule, (triangle, region, axis))
    face_u, face_v = (
        dr.gather(mi.Int32, each, column) for each in (columns.face_u, columns.face_v)
    )
    thick = view.slot.thickness
    if thickness is not None:
        thick = dr.select(view.slot.is_sloped, thickness, 0.0)
    is_upward = view.slot.behind > 0
    nudge = dr.detach(
        view.low_depth - dr.minimum(dr.minimum(view.depth[0], view.depth[1]), view.depth[2])
    )
    low_u, low_v = (mi.Float64(face * CELLS_PER_EDGE) for face in (face_u, face_v))
    low = mi.Float64(layer) - dr.select(is_upward, mi.Float64(thick), 0.0)
    high = mi.Float64(layer) + 1.0 + dr.select(is_upward, 0.0, mi.Float64(thick))
    area = clipped_area(
        view.u,
        view.v,
        [corner + nudge for corner in view.depth],
        (low_u, low_v, low),
        (low_u + CELLS_PER_EDGE, low_v + CELLS_PER_EDGE, high),
    )
    return area, face_word(Columns(view, face_u, face_v), table)(layer)
