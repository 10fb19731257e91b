"""Numbers and masks as Mitsuba's stubs want them; nothing happens here at run time.

The stubs name one class twice: `mi.Float` is what scalars are made with, `drjit.auto.ad.Float` is
what vectors are made of, what they are multiplied with, and what Mitsuba's methods take; the same
goes for masks and integers. At run time both are the class of the variant that is set, and a Python
number passed to a method becomes one by itself. So each function returns what it is given. In the
other direction a constructor does: `mi.Float(vector.x)` is the same array again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    import mitsuba as mi
    from drjit.auto.ad import Bool, Float, UInt32


def as_component(value: float | mi.Float | Float) -> Float:
    """Return `value`, named as a component of a vector or an argument of Mitsuba's methods."""
    return cast("Float", value)


def as_mask(value: bool | mi.Bool | Bool) -> Bool:
    """Return `value`, named as a mask that Mitsuba's methods take."""
    return cast("Bool", value)


def as_bits(value: int | mi.UInt32 | UInt32) -> UInt32:
    """Return `value`, named as an integer that Mitsuba's functions take."""
    return cast("UInt32", value)
