"""Toroidal addressing: a voxel of the world is always stored at the same place of its level.

A voxel is an unbounded integer cell of a level's lattice; its texel is the voxel modulo the
resolution, so moving a window copies nothing: what leaves on one side makes room for what enters on
the other. Positions are XYZ; storage order within a level is [z, y, x].
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import ClipmapLayout, LevelLayout


@dataclass
class LevelTable:
    """The layout of all levels as device arrays, to be looked up by a lane's own level.

    Attributes
    ----------
    origins
        Flat [level, 4]: lowest voxel x, y, z of the window and log2 of the resolution.
    voxel_offsets
        [level]: first voxel of the level in storage.
    """

    origins: mi.Int32
    voxel_offsets: mi.UInt32


def level_table(layout: ClipmapLayout) -> LevelTable:
    """Return `layout` as device arrays."""
    rows: list[int] = []
    for level in layout.levels:
        rows += [*level.origin, level.resolution.bit_length() - 1]
    return LevelTable(mi.Int32(rows), mi.UInt32(list(layout.voxel_offsets)))


def voxel_from_position(p_world: mi.Point3f, level: LevelLayout) -> mi.Vector3i:
    """Voxel of `level` that holds a world point; exact to the rounding of one division."""
    return mi.Vector3i(dr.floor(p_world / level.voxel_size))


def is_inside(voxel: mi.Vector3i, level: LevelLayout) -> mi.Bool:
    """Whether `voxel` lies in the window of `level`."""
    inside = mi.Bool(True)
    for axis in range(3):
        inside &= (voxel[axis] >= level.origin[axis]) & (
            voxel[axis] < level.origin[axis] + level.resolution
        )
    return inside


def texel_from_voxel(voxel: mi.Vector3i, resolution: int) -> mi.UInt32:
    """Storage index of a voxel within its level, in [0, resolution^3).

    One to one on any window of `resolution`^3 voxels.
    """
    x, y, z = (mi.UInt32(voxel[axis] & (resolution - 1)) for axis in range(3))
    return (z * resolution + y) * resolution + x


def voxel_from_texel(texel: mi.UInt32, level: LevelLayout) -> mi.Vector3i:
    """Voxel of the window of `level` that is stored at `texel`; inverts `texel_from_voxel`."""
    resolution = level.resolution
    stored = (texel % resolution, (texel // resolution) % resolution, texel // resolution**2)
    return mi.Vector3i(
        [
            level.origin[axis] + ((mi.Int32(stored[axis]) - level.origin[axis]) & (resolution - 1))
            for axis in range(3)
        ]
    )
