"""Depth of a triangle's plane over the cells of a face."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slots import BEHIND_NUDGE
from vctgi.stages.voxelization.columns import CELLS_PER_EDGE, Columns, FaceView


@dataclass
class DepthPlane:
    """Depth of the cells of a face, moved a little behind the surface, in voxels.

    Attributes
    ----------
    corner
        Depth at the centre of cell (0, 0).
    slope_u, slope_v
        What it gains per cell.
    """

    corner: mi.Float64
    slope_u: mi.Float64
    slope_v: mi.Float64


def depth_plane(view: FaceView, columns: Columns) -> DepthPlane:
    """Return the depths of the plane of a triangle over a face."""
    (u0, u1, u2), (v0, v1, v2), (d0, d1, d2) = view.u, view.v, view.depth
    doubled = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
    scale = dr.select(doubled == 0.0, 0.0, 1.0 / dr.select(doubled == 0.0, 1.0, doubled))
    slope_u = ((d1 - d0) * (v2 - v0) - (d2 - d0) * (v1 - v0)) * scale
    slope_v = ((u1 - u0) * (d2 - d0) - (u2 - u0) * (d1 - d0)) * scale
    to_u, to_v = (
        mi.Float64(face * CELLS_PER_EDGE) + 0.5 - corner
        for face, corner in ((columns.face_u, u0), (columns.face_v, v0))
    )
    nudge = mi.Float64(view.slot.behind) * BEHIND_NUDGE
    return DepthPlane(d0 + slope_u * to_u + slope_v * to_v + nudge, slope_u, slope_v)
