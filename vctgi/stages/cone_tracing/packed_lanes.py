"""Lanes that have work, moved next to one another.

A GPU runs 32 neighbouring lanes in step, as long as the longest of them. Where few lanes of a
picture trace a cone, most of each 32 wait for one; packed, they fill as few as they can. No number
goes to the host, so that frames can be recorded.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass
class PackedLanes:
    """Which lane's work each lane does.

    Attributes
    ----------
    source
        The lane whose work it is.
    active
        Whether there is any: false for all but as many of the first lanes as have work.
    """

    source: mi.UInt32
    active: mi.Bool


def pack_lanes(active: mi.Bool, width: int) -> PackedLanes:
    """Share out the work of active lanes among the first ones.

    The order may differ from run to run, so what a lane finds must not depend on its number.

    Parameters
    ----------
    active
        Which lanes have work.
    width
        Number of lanes.
    """
    counter = dr.opaque(mi.UInt32, 0)
    place = dr.scatter_inc(counter, mi.UInt32(0), active)
    order = dr.empty(mi.UInt32, width)
    dr.scatter(order, dr.arange(mi.UInt32, width), place, active)
    dr.eval(order, counter)
    lane = dr.arange(mi.UInt32, width)
    is_used = lane < dr.gather(mi.UInt32, counter, 0)
    return PackedLanes(dr.gather(mi.UInt32, order, lane, is_used), is_used)
