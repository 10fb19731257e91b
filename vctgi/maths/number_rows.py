"""Numbers that kernels read from arrays of one row, each by a place that the host knows.

A number that a kernel holds makes another kernel each time that it changes, and one that is opaque
costs a launch of its own. A row is copied to the device at once and read where it is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import drjit as dr
import mitsuba as mi

from vctgi.maths.constant_tables import constant_table

Array = TypeVar("Array", "mi.Float", "mi.Float64", "mi.Int32")


def start_of_row() -> mi.UInt32:
    """Return 0, which Dr.Jit does not know: a known place is read by a copy of its own."""
    return constant_table(("start of a row",), lambda: dr.opaque(mi.UInt32, 0))


def entry(array: Array, place: int) -> Array:
    """Return a number of an array that is evaluated, as one lane, without a launch for it."""
    return dr.gather(type(array), array, start_of_row() + place)


class IntegerRow:
    """Whole numbers, each read as one lane by its place.

    Parameters
    ----------
    values
        Two at least: Dr.Jit makes a single one a constant of the kernel.
    """

    def __init__(self, values: Sequence[int]) -> None:
        self._array = mi.Int32(list(values))

    def __getitem__(self, place: int) -> mi.Int32:
        """Return the number at a place."""
        return entry(self._array, place)


class FloatRow:
    """The same of numbers in single precision."""

    def __init__(self, values: Sequence[float]) -> None:
        self._array = mi.Float(list(values))

    def __getitem__(self, place: int) -> mi.Float:
        """Return the number at a place."""
        return entry(self._array, place)
