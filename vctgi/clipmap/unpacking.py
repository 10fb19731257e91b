"""Stored voxels back as numbers, through the same fetch as the read: for pictures and for tests."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import voxel_from_texel
from vctgi.clipmap.formats import LevelTexels
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.neighbourhood import Layer, neighbourhood, scaled
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.stub_gaps import as_component


def unpack_level(volume: VoxelVolume, level: LevelLayout) -> LevelTexels:
    """Return what a read meets in the centre of each voxel of a level.

    Parameters
    ----------
    volume
        Stored voxels, in any format.
    level
        One of the levels of its layout.

    Returns
    -------
    LevelTexels
        All six directions, [direction, z, y, x] at toroidal addresses. Where fewer are stored,
        directions are alike; where the level is stored as empty, all is 0.
    """
    count = level.voxel_count
    voxel = voxel_from_texel(dr.arange(mi.UInt32, count), level)
    around = neighbourhood(volume.table, dr.full(mi.UInt32, level.level, count), mi.Point3f(voxel))
    opacity = dr.empty(mi.Float, DIRECTION_COUNT * count)
    emittance = dr.empty(mi.Color3f, DIRECTION_COUNT * count)
    for slot in range(DIRECTION_COUNT):
        axis, side = divmod(slot, 2)
        texel = mi.Vector4f(0.0)
        layer = Layer(axis, mi.UInt32(side), mi.Float(voxel[axis]))
        for weight_u, weight_v, tap in volume.texels.taps(around, layer):
            texel = dr.fma(as_component(weight_u * weight_v), tap, texel)
        index = dr.arange(mi.UInt32, count) + slot * count
        dr.scatter(emittance, scaled(volume.texels, mi.Color3f(texel.x, texel.y, texel.z)), index)
        dr.scatter(opacity, mi.Float(texel.w), index)
    dr.eval(opacity, emittance)
    return LevelTexels(emittance, opacity, DIRECTION_COUNT)
