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
    """Deal texels to cells: one, and of those left over a share as large as the cell's weight.

    Parameters
    ----------
    weight
        Of each cell, >= 0 and finite; if all of a grid are 0 they count as equal. Several grids of
        as many cells each stand one after the other.
    texel_counts
        Texels to deal to each grid; with fewer than cells each cell still gets its one.

    Returns
    -------
    mi.UInt32
        Texels of all cells of a grid up to each, with that one's.
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
    return end + cell % cell_count + 1


def own_texels(dealt: mi.UInt32, cell: mi.UInt32, cell_count: int) -> mi.UInt32:
    """Return the texels of cells, of what `deal` returned for grids of so many cells."""
    before = dr.gather(mi.UInt32, dealt, cell - 1, cell % cell_count > 0)
    return dr.gather(mi.UInt32, dealt, cell) - before


def block_max(value: mi.Float, block_size: int) -> mi.Float:
    """Return the largest of each `block_size` values that follow one another."""
    return mi.Float(dr.block_reduce(dr.ReduceOp.Max, value, block_size))


def dealt_count(cell_count: int, texel_count: int) -> int:
    """Return how many texels `deal` hands out."""
    return max(texel_count, cell_count)


def owner(dealt: mi.UInt32, grid: mi.UInt32, texel: mi.UInt32, cell_count: int) -> mi.UInt32:
    """Return the cells of texels, all texels of the first cell before those of the second.

    Parameters
    ----------
    dealt
        What `deal` returned for grids of `cell_count` cells.
    grid, texel
        Grid of each texel, and its number among the texels of that.
    """

    def is_before(number: mi.UInt32) -> mi.Bool:
        return dr.gather(mi.UInt32, dealt, grid * cell_count + number) <= texel

    found = dr.binary_search(0, cell_count, is_before)  # type: ignore[no-untyped-call]
    return grid * cell_count + mi.UInt32(found)


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
    for first in range(0, axis_count, 2):
        strides = [per_axis**axis for axis in range(first, min(first + 2, axis_count))]
        # Two axes in one launch.
        weight = _blurred(weight, cell, per_axis, strides)
    return weight


def _blurred(weight: mi.Float, cell: mi.UInt32, per_axis: int, strides: Sequence[int]) -> mi.Float:
    """Return the weights of cells, blurred along the axes of these strides."""
    if not strides:
        return dr.gather(mi.Float, weight, cell)
    *inner, stride = strides
    place = cell // stride % per_axis
    first = cell - place * stride
    before = first + (place + per_axis - 1) % per_axis * stride
    after = first + (place + 1) % per_axis * stride
    own, low, high = (_blurred(weight, each, per_axis, inner) for each in (cell, before, after))
    return 0.5 * own + 0.25 * (low + high)
