"""Dealing a number of texels to cells in proportion to weights, all of it where the arrays are.

Weights are added up as integers, so that the sum does not depend on the order in which a device
takes them, and equal pilots deal equal texels.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi

WEIGHT_BITS = 32
"""Fixed point of a weight over the largest: up to 2^16 cells add up without rounding in 64 bits."""


def deal(weight: mi.Float, *texel_counts: int) -> mi.UInt32:
    """Return the texels of each cell: one, and of those left over a share as large as its weight.

    Parameters
    ----------
    weight
        Of each cell, >= 0 and finite; if all of a grid are 0 they count as equal. Several grids of
        as many cells each stand one after the other.
    texel_counts
        Texels to deal to each grid; with fewer than cells each cell still gets its one.
    """
    return deal_spare(weight, spare_texels(dr.width(weight) // len(texel_counts), texel_counts))


def spare_texels(cell_count: int, texel_counts: Sequence[int]) -> mi.Float64:
    """Return the texels of grids that are left when each of their cells has one."""
    return mi.Float64([float(max(count - cell_count, 0)) for count in texel_counts])


def deal_spare(weight: mi.Float, spare: mi.Float64) -> mi.UInt32:
    """Return the texels of each cell, as `deal` does, of so many to spare in each grid."""
    cell_count = dr.width(weight) // dr.width(spare)
    cell = dr.arange(mi.UInt32, dr.width(weight))
    grid = cell // cell_count
    largest = dr.gather(mi.Float, block_max(weight, cell_count), grid)
    is_dark = largest <= 0.0
    relative = dr.select(is_dark, 1.0, weight / dr.select(is_dark, 1.0, largest))
    fixed = mi.UInt64(mi.Float64(relative) * float(1 << WEIGHT_BITS))
    up_to = mi.UInt64(dr.block_prefix_sum(fixed, cell_count, exclusive=False))
    dr.eval(up_to)
    total = mi.Float64(dr.gather(mi.UInt64, up_to, (grid + 1) * cell_count - 1))
    share = mi.Float64(up_to) / total
    end = mi.UInt32(dr.floor(share * dr.gather(mi.Float64, spare, grid) + 0.5))
    begin = dr.gather(mi.UInt32, end, cell - 1, cell % cell_count > 0)
    return 1 + end - begin


def block_max(value: mi.Float, block_size: int) -> mi.Float:
    """Return the largest of each `block_size` values that follow one another."""
    return mi.Float(dr.block_reduce(dr.ReduceOp.Max, value, block_size))


def dealt_count(cell_count: int, texel_count: int) -> int:
    """Return how many texels `deal` hands out."""
    return max(texel_count, cell_count)


def owners(dealt: mi.UInt32, texel_count: int) -> mi.UInt32:
    """Return the cell of each texel, all texels of the first cell before those of the second.

    Parameters
    ----------
    dealt
        Texels of each cell, each at least 1.
    texel_count
        Their sum.
    """
    is_first = dr.zeros(mi.UInt32, texel_count)
    dr.scatter(is_first, 1, dr.prefix_sum(dealt))
    return dr.cumsum(is_first) - 1


def smoothed(weight: mi.Float, per_axis: int, axis_count: int) -> mi.Float:
    """Return weights of grids of cells, blurred by (1, 2, 1) / 4 along each axis, which wraps.

    Parameters
    ----------
    weight
        Of each cell; the first axis varies fastest, and grid stands after grid.
    per_axis, axis_count
        Cells along each axis, and how many axes there are.
    """
    cell = dr.arange(mi.UInt32, dr.width(weight))
    stride = 1
    for _ in range(axis_count):
        place = cell // stride % per_axis
        before = cell - place * stride + (place + per_axis - 1) % per_axis * stride
        after = cell - place * stride + (place + 1) % per_axis * stride
        sides = dr.gather(mi.Float, weight, before) + dr.gather(mi.Float, weight, after)
        weight = 0.5 * weight + 0.25 * sides
        stride *= per_axis
    return weight
