"""Numbers by which Dr.Jit knows Mitsuba's objects, and tables that kernels read by them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Union

import drjit as dr
import mitsuba as mi
import numpy as np

Pointer = Union["mi.BSDFPtr", "mi.EmitterPtr", "mi.ShapePtr"]
"""Objects, one a lane."""


def registry_numbers(pointers: Pointer) -> mi.UInt32:
    """Return the number of each lane's object in Dr.Jit's registry; 0 is none."""
    return mi.UInt32(dr.reinterpret_array(mi.UInt32, pointers))


def registry_number(pointer: Pointer) -> int:
    """Return the number of one object, which the host waits for."""
    return int(registry_numbers(pointer)[0])


def table_by_number(values: Mapping[int, int], other: int) -> mi.UInt32:
    """Return a table of whole numbers that kernels read by the numbers of objects.

    Parameters
    ----------
    values
        By number of the object.
    other
        What other objects read, where they do not lie behind the end of the table.
    """
    # Two at least, or Dr.Jit makes it a constant. Copied: a NumPy array would be read in place, and
    # by another kernel each time that its memory is aligned otherwise.
    entries = np.full(max([1, *values]) + 1, other, dtype=np.uint32)
    entries[list(values)] = list(values.values())
    table = mi.UInt32(entries.tolist())
    dr.make_opaque(table)
    return table


def read_by_number(
    table: mi.UInt32, pointers: Pointer, active: mi.Bool
) -> tuple[mi.UInt32, mi.Bool]:
    """Return what a table holds of each lane's object, and the active lanes that stand in it."""
    number = registry_numbers(pointers)
    active = active & (number < dr.width(table))
    return dr.gather(mi.UInt32, table, number, active), active
