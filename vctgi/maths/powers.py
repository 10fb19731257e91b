"""Powers of two by the bits of a number: exact, and of two or three instructions."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

MANTISSA_BITS, BIAS = 23, 127
"""Of numbers in single precision."""


def power_of_two(exponent: mi.Int32) -> mi.Float:
    """Return 2 to whole exponents in -126 .. 127."""
    bits = mi.UInt32(exponent + BIAS) << MANTISSA_BITS
    return mi.Float(dr.reinterpret_array(mi.Float, bits))


def ceil_log2(value: mi.Float) -> mi.Int32:
    """Return the smallest whole exponents whose powers reach values, normal numbers above 0.

    They have no derivatives: they jump.
    """
    bits = mi.Int32(dr.reinterpret_array(mi.Int32, dr.detach(value)))
    # A power of two is its own: one less has the exponent before.
    return ((bits - 1) >> MANTISSA_BITS) - (BIAS - 1)


def reciprocal_of_power(power: mi.Float) -> mi.Float:
    """Return one over powers of two in 2^-126 .. 2^126."""
    bits = mi.UInt32(dr.reinterpret_array(mi.UInt32, power))
    return mi.Float(dr.reinterpret_array(mi.Float, (2 * BIAS << MANTISSA_BITS) - bits))
