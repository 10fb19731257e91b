"""What is lit: boxes of a level, as places in a list of their voxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel, voxel_of_place
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.regions import Region, count_voxels
from vctgi.maths.directions import DIRECTION_COUNT

NOWHERE = 0xFFFFFFFF
"""Place of a voxel that is not lit anew."""


@dataclass
class Target:
    """Boxes of a level that are lit anew.

    Attributes
    ----------
    level
        The window.
    boxes
        What is lit anew.
    place
        For each texel of the level its place in the list of voxels; `NOWHERE` outside the boxes.
    count
        Voxels of the list.
    sums
        For each channel the sums [direction, place] in fixed point.
    steps
        Fixed-point steps per unit of the first three channels, and of the other three.
    device_steps
        The same, as numbers that no kernel holds.
    mirror, live
        What texels add to the slots [direction, z, y, x] that they lie in, in emittance with
        derivatives, and what slots have of it after the pre-filter; None where there are none.
    """

    level: LevelLayout
    boxes: Sequence[Region]
    place: mi.UInt32
    count: mi.UInt32
    sums: list[mi.Int64]
    steps: list[float]
    device_steps: list[mi.Float64]
    mirror: list[mi.Float64] | None = None
    live: list[mi.Float] | None = None


def make_target(
    boxes: Sequence[Region], level: LevelLayout, channel_count: int, steps: tuple[float, float]
) -> Target:
    """Return the boxes of a level with nothing summed yet."""
    count = count_voxels(boxes)
    place = dr.full(mi.UInt32, NOWHERE, level.voxel_count)
    if count:
        lane = dr.arange(mi.UInt32, count)
        texel = texel_from_voxel(voxel_of_place(lane, boxes), level.resolution)
        dr.scatter(place, lane, texel)
    size = max(1, DIRECTION_COUNT * count)
    sums = [dr.zeros(mi.Int64, size) for _ in range(channel_count)]
    scales = [dr.opaque(mi.Float64, each) for each in steps[: channel_count // 3]]
    return Target(level, boxes, place, dr.opaque(mi.UInt32, count), sums, list(steps), scales)
