"""Numbers of the host that kernels read from one array.

A number that a kernel holds makes another kernel each time that it changes, and one that is opaque
costs a launch of its own. A row is copied to the device at once and read where it is needed.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi

from vctgi.maths.constant_tables import constant_table


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
        return dr.gather(mi.Int32, self._array, _start() + place)


class FloatRow:
    """The same of numbers in single precision."""

    def __init__(self, values: Sequence[float]) -> None:
        self._array = mi.Float(list(values))

    def __getitem__(self, place: int) -> mi.Float:
        """Return the number at a place."""
        return dr.gather(mi.Float, self._array, _start() + place)


def _start() -> mi.UInt32:
    """Return 0, which Dr.Jit does not know: places that it knows are copied one by one."""
    return constant_table(("start of a row",), lambda: dr.opaque(mi.UInt32, 0))
