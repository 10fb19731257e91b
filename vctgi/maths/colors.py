"""Means over the channels of a colour."""

from __future__ import annotations

import mitsuba as mi


def channel_mean(color: mi.Color3f) -> mi.Float:
    """Return the mean of three channels.

    `dr.mean` writes the number of lanes into the kernel, so that each number compiles its own.
    """
    return mi.Float((color.x + color.y + color.z) * (1.0 / 3.0))
