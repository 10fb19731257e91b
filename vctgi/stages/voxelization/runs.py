"""Runs: the numbers 0, 1, 2, ... dealt out to lanes that want a few each.

A triangle wants a lane for each of its columns. Laid end to end, the wishes of all triangles are
runs of numbers, and each number has one owner.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass
class Runs:
    """Where the run of each lane begins, and how many numbers there are.

    Attributes
    ----------
    starts
        First number of each lane's run, which may be empty.
    total
        Numbers of all runs, below 2^32.
    """

    starts: mi.UInt32
    total: int


def lay_out_runs(counts: mi.UInt32) -> Runs | None:
    """Return the runs of lanes that want `counts` numbers each; None if they want too many.

    Too many are 2^32 or more, which a lane number does not hold.
    """
    ends = dr.cumsum(mi.UInt64(counts))
    total = int(ends[dr.width(ends) - 1]) if dr.width(ends) else 0
    return Runs(mi.UInt32(ends - mi.UInt64(counts)), total) if total < 2**32 else None


def owners(runs: Runs, begin: int, end: int) -> mi.UInt32:
    """Return which lane owns each number in [begin, end), of which there is at least one."""
    first, after = dr.opaque(mi.UInt32, begin), dr.opaque(mi.UInt32, end)
    is_before = mi.Bool(runs.starts < first)
    # Of several lanes that begin at one number, all but the last are empty.
    is_new = dr.zeros(mi.UInt32, end - begin)
    dr.scatter_reduce(
        dr.ReduceOp.Add,
        is_new,
        mi.UInt32(1),
        runs.starts - first,
        ~is_before & (runs.starts < after),
        dr.ReduceMode.Direct,
    )
    dr.eval(runs.starts, is_new)
    found = mi.UInt32(dr.cumsum(is_new)) - 1
    if begin > 0:
        # Counted, not added to the first number: millions of lanes would wait for each other there.
        one = mi.UInt32(1)
        found += dr.sum(dr.select(is_before, one, mi.UInt32(0)))
    return found
