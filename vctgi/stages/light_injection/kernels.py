"""Kernels that light is spread with: B-splines, taken from voxel to voxel.

Only the voxel of a texel counts, not where in it the texel lies. Surfaces fill parts of voxels, and
weights that followed the place in the voxel would not average to those that the balance of slots
is found for: even light on slanted walls came out with stripes of 7 % of its radiance, against 1 %.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

TAPS = {3: (0.75, 0.125), 5: (230.0 / 384.0, 76.0 / 384.0, 1.0 / 384.0)}
"""The quadratic and the quartic B-spline at whole steps from the middle, by width."""


def tap_weight(step: mi.Int32, width: int) -> mi.Float:
    """Weight of a voxel `step` voxels from the middle along an axis; 0 beyond the kernel."""
    distance = dr.abs(step)
    weight = mi.Float(0.0)
    for number, tap in enumerate(TAPS[width]):
        weight = dr.select(distance == number, mi.Float(tap), weight)
    return weight
