"""Alpha masks: which cells of a face stop light, by the null transmission of a BSDF."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import drjit as dr
import mitsuba as mi

from vctgi.maths.colors import channel_mean
from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.voxelization.columns import CELLS_PER_EDGE, Columns
from vctgi.stages.voxelization.depth_plane import DepthPlane
from vctgi.stages.voxelization.triangles import NO_MASK, DeviceTriangles


def opaque_cells(
    covered: mi.UInt64, columns: Columns, plane: DepthPlane, triangles: DeviceTriangles
) -> mi.UInt64:
    """Keep the cells at which an alpha mask stops light, dithered so that their mean is right."""
    is_opaque = opacity_test(columns, plane, triangles)
    has_mask = has_masks(columns, triangles)

    def body(kept: mi.UInt64, left: mi.UInt64) -> tuple[mi.UInt64, mi.UInt64]:
        cell = mi.UInt32(dr.tzcnt(left))
        bit = mi.UInt64(1) << mi.UInt64(cell)
        return kept | dr.select(is_opaque(cell), bit, 0), left & ~bit

    kept, _ = dr.while_loop(
        state=(dr.select(has_mask, mi.UInt64(0), covered), dr.select(has_mask, covered, 0)),
        cond=lambda kept, left: left != 0,
        body=body,
        labels=("kept", "left"),
        label="opaque_cells",
    )
    return mi.UInt64(kept)


def has_masks(columns: Columns, triangles: DeviceTriangles) -> mi.Bool:
    """Whether the triangle of each column has a mask."""
    assert triangles.mask is not None, "no triangle has a mask"
    return dr.gather(mi.UInt32, triangles.mask, columns.view.triangle) != NO_MASK


def opacity_test(
    columns: Columns, plane: DepthPlane, triangles: DeviceTriangles
) -> Callable[[mi.UInt32], mi.Bool]:
    """Return the function that says whether the mask of `triangles` stops light at a cell."""
    view = columns.view
    assert triangles.mask is not None, "only masked surfaces have cells that are not opaque"
    number = dr.gather(mi.UInt32, triangles.mask, view.triangle)
    mask = cast("mi.BSDFPtr", dr.reinterpret_array(mi.BSDFPtr, number))
    (u0, u1, u2), (v0, v1, v2) = view.u, view.v
    corners = [dr.gather(mi.Point2f, corner, view.triangle) for corner in triangles.uv]
    doubled = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
    per_doubled = 1.0 / dr.select(doubled == 0.0, 1.0, doubled)

    def is_opaque(cell: mi.UInt32) -> mi.Bool:
        local_u, local_v = cell % CELLS_PER_EDGE, cell // CELLS_PER_EDGE
        cell_u = columns.face_u * CELLS_PER_EDGE + mi.Int32(local_u)
        cell_v = columns.face_v * CELLS_PER_EDGE + mi.Int32(local_v)
        to_u, to_v = mi.Float64(cell_u) + 0.5 - u0, mi.Float64(cell_v) + 0.5 - v0
        second = (to_u * (v2 - v0) - (u2 - u0) * to_v) * per_doubled
        third = ((u1 - u0) * to_v - to_u * (v1 - v0)) * per_doubled
        shares = [mi.Float(1.0 - second - third), mi.Float(second), mi.Float(third)]
        uv = mi.Point2f(0.0)
        for share, corner in zip(shares, corners, strict=True):
            uv += as_component(share) * corner
        depth = plane.corner + plane.slope_u * mi.Float64(local_u)
        depth += plane.slope_v * mi.Float64(local_v)
        layer = mi.Int32(dr.floor(dr.clip(depth, view.low_depth, view.high_depth)))
        threshold = random_unit(
            mi.UInt32(cell_u) + 0x9E3779B9 * mi.UInt32(cell_v) + 0x85EBCA6B * mi.UInt32(layer), 0
        )
        return _passed(mask, uv) <= threshold

    return is_opaque


def _passed(mask: mi.BSDFPtr, uv: mi.Point2f) -> mi.Float:
    """Share of light that a mask lets through at texture coordinates."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(uv))
    si.uv = uv
    si.wi = mi.Vector3f(0.0, 0.0, 1.0)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    return channel_mean(mi.Color3f(mask.eval_null_transmission(si)))
