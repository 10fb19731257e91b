"""Toroidal addressing: a voxel of the world is always stored at the same place of its level.

A voxel is an unbounded integer cell of a level's lattice; its texel is the voxel modulo the
resolution, so moving a window copies nothing: what leaves on one side makes room for what enters on
the other. Positions are XYZ; storage order within a level is [z, y, x].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.clipmap.regions import Region
from vctgi.maths.number_rows import FloatRow


@dataclass
class LevelTable:
    """The layout of all levels as device arrays, to be looked up by a lane's own level.

    Attributes
    ----------
    windows
        Flat [level, 4]: lowest voxel x, y, z of the window, and voxels along an edge of it; whole
        numbers, exact below 2^24, as places in voxels are.
    voxel_offsets
        [level]: first voxel of the level in storage.
    centre
        World point that the windows surround before snapping.
    low, high
        Corners of the coarsest window, world units.
    """

    windows: mi.Float
    voxel_offsets: mi.UInt32
    centre: mi.Point3f
    low: mi.Point3f
    high: mi.Point3f


def level_table(
    layout: ClipmapLayout, is_empty: Sequence[bool] = (), offsets: Sequence[int] | None = None
) -> LevelTable:
    """Return `layout` as device arrays, so that no kernel holds where its windows stand.

    Parameters
    ----------
    layout
        Windows.
    is_empty
        Levels whose window shrinks to one voxel; none if left out.
    offsets
        First stored voxel of each level; those of `layout` if left out.
    """
    rows: list[int] = []
    for level, empty in zip(layout.levels, is_empty or [False] * len(layout.levels), strict=True):
        rows += [0, 0, 0, 1] if empty else [*level.origin, level.resolution]
    box = layout.coarsest
    row = FloatRow([*layout.centre, *box.window_min, *box.window_max])
    points = [mi.Point3f(*(row[3 * place + axis] for axis in range(3))) for place in range(3)]
    dr.eval(points)
    return LevelTable(
        mi.Float(rows),
        mi.UInt32(list(layout.voxel_offsets if offsets is None else offsets)),
        *points,
    )


LEAST_BOXES = 8
"""Boxes that a search among a few is made for."""

NO_PLACE = 2**32 - 1
"""Behind all places in a list of voxels."""


def voxel_of_place(place: mi.UInt32, regions: Sequence[Region]) -> mi.Vector3i:
    """Return the voxel at each place in the list of all voxels of boxes of one lattice.

    The list goes box after box, in each of them x fastest.
    """
    starts = [0, *accumulate(region.voxel_count for region in regions)][:-1]
    # Boxes that begin behind all places, so that few numbers of boxes make kernels of their own.
    count = max(LEAST_BOXES, 1 << (len(regions) - 1).bit_length())
    first = mi.UInt32(starts + [NO_PLACE] * (count - len(regions)))

    def is_before(number: mi.UInt32) -> mi.Bool:
        return dr.gather(mi.UInt32, first, number) <= place

    # The last box that starts at or before the place.
    after = dr.binary_search(1, count, is_before)  # type: ignore[no-untyped-call]
    owner = mi.UInt32(after) - 1
    local = place - dr.gather(mi.UInt32, first, owner)
    low = mi.Int32([i for region in regions for i in region.low])
    shape = mi.Int32([i for region in regions for i in region.shape])
    # The unused lanes of the last SIMD packet gather 0, and the CPU traps a division by it.
    width, height = (
        mi.UInt32(dr.maximum(dr.gather(mi.Int32, shape, 3 * owner + axis), 1)) for axis in range(2)
    )
    steps = (local % width, (local // width) % height, local // (width * height))
    return mi.Vector3i(
        [dr.gather(mi.Int32, low, 3 * owner + axis) + mi.Int32(i) for axis, i in enumerate(steps)]
    )


def voxel_from_position(p_world: mi.Point3f, level: LevelLayout) -> mi.Vector3i:
    """Voxel of `level` that holds a world point; exact to the rounding of one division."""
    return mi.Vector3i(dr.floor(p_world / level.voxel_size))


def is_inside(voxel: mi.Vector3i, level: LevelLayout) -> mi.Bool:
    """Whether `voxel` lies in the window of `level`."""
    return window_test(level)(voxel)


def window_test(level: LevelLayout) -> Callable[[mi.Vector3i], mi.Bool]:
    """Return what tells whether voxels lie in the window of `level`, for more than one use."""
    # Opaque, so that a window that moves compiles nothing.
    origin = [dr.opaque(mi.Int32, each) for each in level.origin]

    def holds(voxel: mi.Vector3i) -> mi.Bool:
        inside = mi.Bool(True)
        for axis in range(3):
            # Unsigned tests both ends at once.
            inside &= mi.UInt32(voxel[axis] - origin[axis]) < level.resolution
        return inside

    return holds


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
    # Opaque, so that a window that moves compiles nothing.
    origin = [dr.opaque(mi.Int32, each) for each in level.origin]
    return mi.Vector3i(
        [
            origin[axis] + ((mi.Int32(stored[axis]) - origin[axis]) & (resolution - 1))
            for axis in range(3)
        ]
    )


def gather_own(
    arrays: Sequence[mi.Float], number: mi.UInt32, index: mi.UInt32, active: mi.Bool
) -> mi.Float:
    """Return entries of the array that belongs to each lane, such as its level's; else 0.

    Parameters
    ----------
    arrays
        One for each level.
    number
        Which of them is the lane's.
    index
        Where in it.
    active
        Lanes to read; the others get 0.
    """
    found = mi.Float(0.0)
    for each, array in enumerate(arrays):
        found += dr.gather(mi.Float, array, index, active & (number == each))
    return found
