"""Fewer directions than six, for comparison and for low-quality tracing.

Three directions hold for each axis the larger opacity and the larger emittance of its two sides.
That is right where a voxel shows one face or two alike, and shows the brighter one otherwise; it
cannot tell the two faces of a thin wall, so a lit face shines through it. One direction holds the
mean of these over the axes; it cannot tell a wall from the space beside it either.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import LevelTexels
from vctgi.maths.directions import DIRECTION_COUNT


def reduce_directions(texels: LevelTexels, direction_count: int) -> LevelTexels:
    """Return the texels of a level with 6, 3 or 1 directions, made from six."""
    assert texels.direction_count == DIRECTION_COUNT, "only six directions can be reduced"
    if direction_count == DIRECTION_COUNT:
        return texels
    voxel_count = dr.width(texels.opacity) // DIRECTION_COUNT
    index = dr.arange(mi.UInt32, 3 * voxel_count)
    axis, voxel = index // voxel_count, index % voxel_count
    towards_upper = 2 * axis * voxel_count + voxel
    towards_lower = towards_upper + voxel_count
    opacity = dr.maximum(
        dr.gather(mi.Float, texels.opacity, towards_upper),
        dr.gather(mi.Float, texels.opacity, towards_lower),
    )
    emittance = dr.maximum(
        dr.gather(mi.Color3f, texels.emittance, towards_upper),
        dr.gather(mi.Color3f, texels.emittance, towards_lower),
    )
    if direction_count == 1:
        dr.eval(opacity, emittance)
        voxel = dr.arange(mi.UInt32, voxel_count)
        axes = [voxel + axis * voxel_count for axis in range(3)]
        opacity = sum((dr.gather(mi.Float, opacity, k) for k in axes), mi.Float(0.0)) / 3.0
        emittance = sum((dr.gather(mi.Color3f, emittance, k) for k in axes), mi.Color3f(0.0)) / 3.0
    return LevelTexels(emittance, opacity, direction_count)
