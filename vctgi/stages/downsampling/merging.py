"""How eight children make a voxel: which they are, and what is made of their values."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.maths.stub_gaps import as_component
from vctgi.stages.downsampling.config import MipRule

Pair = tuple["mi.Vector3i", "mi.Vector3i"]
"""The child in front and the one behind."""


def children(parent: mi.Vector3i, direction: mi.UInt32, mips: MipRule) -> list[Pair]:
    """Return the children of a voxel, column by column along a direction.

    Parameters
    ----------
    parent
        Voxel of the coarser level.
    direction
        Along which a ray meets it.
    mips
        A mean over children takes them in one order for all directions, which keeps slots alike
        that are.

    Returns
    -------
    list of Pair
        Voxels of the finer level, for each of the four columns.
    """
    if mips == "average":
        direction = mi.UInt32(0)
    axis, side = direction // 2, mi.Int32(direction % 2)
    columns = []
    for step_u in range(2):
        for step_v in range(2):
            pair = []
            # A ray towards +axis meets the lower child first.
            for step in (side, 1 - side):
                child = [
                    2 * mi.Int32(parent[world_axis])
                    + dr.select(axis == world_axis, step, 0)
                    + dr.select((axis + 1) % 3 == world_axis, mi.Int32(step_u), 0)
                    + dr.select((axis + 2) % 3 == world_axis, mi.Int32(step_v), 0)
                    for world_axis in range(3)
                ]
                pair.append(mi.Vector3i(child))
            columns.append((pair[0], pair[1]))
    return columns


def merge_opacity(
    columns: list[tuple[mi.Float, mi.Float]], mips: MipRule
) -> tuple[mi.Float, list[mi.Float]]:
    """Mean opacity over the columns, and which share of each back child shows in it."""
    if mips == "average":
        values = [value for pair in columns for value in pair]
        return sum(values, mi.Float(0.0)) / len(values), []
    mean, shares = mi.Float(0.0), []
    for front, back in columns:
        visible = dr.minimum(1.0 - front, back)
        mean += 0.25 * (front + visible)
        shares.append(dr.select(back > 0.0, visible / dr.select(back > 0.0, back, 1.0), 0.0))
    return mean, shares


def merge_emittance(
    columns: list[tuple[mi.Color3f, mi.Color3f]], shares: list[mi.Float]
) -> mi.Color3f:
    """Mean emittance over the columns, each merged front to back, or over all of no shares."""
    mean = mi.Color3f(0.0)
    if not shares:
        for value in (value for pair in columns for value in pair):
            mean += value / (2.0 * len(columns))
        return mean
    for (front, back), share in zip(columns, shares, strict=True):
        mean += 0.25 * dr.fma(as_component(share), back, front)
    return mean
