"""Tables of constants on the device, made once for each variant and kept.

What `dr.freeze` records may read them as inputs, but could not make them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import drjit as dr
import mitsuba as mi

Table = TypeVar("Table", "mi.Float", "mi.UInt32")

_kept: dict[str, dict[Hashable, Any]] = {}


def constant_table(key: Hashable, make: Callable[[], Table]) -> Table:
    """Return the table of a key, which is made at the first call; it must not be changed.

    Parameters
    ----------
    key
        Says all that is in the table, and of what type it is.
    make
        Makes it.
    """
    tables = _kept.setdefault(str(mi.variant()), {})
    if key not in tables:
        made = make()
        dr.eval(made)
        tables[key] = made
    table: Table = tables[key]
    return table


def float_table(values: tuple[float, ...]) -> mi.Float:
    """Return a table of few numbers."""
    return constant_table(("float", values), lambda: mi.Float(list(values)))


def number_table(values: tuple[int, ...]) -> mi.UInt32:
    """Return a table of few whole numbers."""
    return constant_table(("number", values), lambda: mi.UInt32(list(values)))


def kept_tables() -> list[mi.Float | mi.UInt32]:
    """Return all tables of the variant that is set."""
    return list(_kept.get(str(mi.variant()), {}).values())
