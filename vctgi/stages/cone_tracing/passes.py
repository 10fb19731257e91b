"""Passes: many cones of many points, traced at a time as far as memory allows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import drjit as dr
import mitsuba as mi

from vctgi.scene.records import GBuffer

MAX_CONES_PER_PASS = 1 << 25
"""Cones that are traced at a time; bounds the memory of a pass."""

Light = TypeVar("Light", "mi.Float", "mi.Color3f")


def trace_in_passes(gbuffer: GBuffer, cone_count: int, trace: Callable[[GBuffer], Light]) -> Light:
    """Trace the cones of all points, `cone_count` each, in as few passes as there may be.

    Parameters
    ----------
    gbuffer
        Points.
    cone_count
        Cones of each.
    trace
        Returns what the cones of some points gather.
    """
    points = dr.width(gbuffer.position)
    block = max(1, MAX_CONES_PER_PASS // cone_count)
    if points <= block:
        return trace(gbuffer)
    parts = []
    for begin in range(0, points, block):
        # Opaque, so that all passes of one size share a kernel.
        first = dr.opaque(mi.UInt32, begin)
        index = dr.arange(mi.UInt32, min(block, points - begin)) + first
        light = trace(dr.gather(GBuffer, gbuffer, index))
        dr.eval(light)
        parts.append((light, index))
    gathered = dr.zeros(type(parts[0][0]), points)
    for light, index in parts:
        dr.scatter(gathered, light, index)
    dr.eval(gathered)
    return gathered
