"""Balance: factors by which slots draw light, so that a pre-filter leaves even light even.

Weights that are only divided by their sum give too much to slots beside a rim or of much opacity,
and too little to the others: a wall under even light comes out striped. A texel's weights are
therefore multiplied by a factor of each slot, found by balancing the kernel between covered slots
until it takes from every slot as much as it gives it [Sinkhorn1967].
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel, voxel_from_texel
from vctgi.clipmap.levels import LevelLayout
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.light_injection.kernels import Taps, scaled_taps

ROUNDS = 4
"""Rounds of balancing, each of which about halves what is left of the stripes."""

SMALLEST_SUM = 1e-12
"""What a covered slot with all its neighbours weighs at least: coverage comes in steps of 1 / 64
and less, and the rarest tap is 1 / 384 along each axis."""


def drawing_power(
    alpha: mi.Float, level: LevelLayout, width: int, taps: Taps | None = None
) -> mi.Float:
    """Return opacity times balancing factor of each slot [direction, z, y, x] of a level.

    Parameters
    ----------
    alpha
        Opacity of the slots.
    level, width
        The window, and the kernel's width.
    taps
        Of the kernel; None: as `kernels.TAPS` has them.

    References
    ----------
    [Sinkhorn1967] R. Sinkhorn, Diagonal equivalence to matrices with prescribed row and column
    sums, American Mathematical Monthly 1967.
    """
    factor = dr.full(mi.Float, 1.0, dr.width(alpha))
    for _ in range(ROUNDS):
        around = alpha * factor
        for axis in range(3):
            around = blurred(around, level, axis, taps or scaled_taps(width))
            dr.eval(around)
        # The square root damps what would swing between two states.
        has_sum = (alpha > 0.0) & (around > SMALLEST_SUM)
        factor = dr.sqrt(factor / dr.select(has_sum, around, 1.0))
        dr.eval(factor)
    power = alpha * factor
    dr.eval(power)
    return power


def blurred(values: mi.Float, level: LevelLayout, axis: int, taps: Taps) -> mi.Float:
    """Return the values of slots blurred along an axis; nothing lies outside the window."""
    lane = dr.arange(mi.UInt32, DIRECTION_COUNT * level.voxel_count)
    texel, base = lane % level.voxel_count, lane // level.voxel_count * level.voxel_count
    voxel = voxel_from_texel(texel, level)
    origin = dr.opaque(mi.Int32, level.origin[axis])
    total = taps[0] * dr.gather(mi.Float, values, lane)
    for distance, tap in enumerate(taps[1:], start=1):
        for step in (-distance, distance):
            other = mi.Vector3i(voxel)
            other[axis] = voxel[axis] + step
            is_held = mi.UInt32(other[axis] - origin) < level.resolution
            index = base + texel_from_voxel(other, level.resolution)
            total = dr.fma(tap, dr.gather(mi.Float, values, index, is_held), total)
    return total
