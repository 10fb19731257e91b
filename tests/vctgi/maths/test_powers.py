"""Powers of two by bits, against exact arithmetic."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctgi.maths.powers import ceil_log2, power_of_two, reciprocal_of_power

pytestmark = pytest.mark.usefixtures("variant")


def test_powers_are_exact_down_to_the_smallest_normal_number() -> None:
    exponents = np.arange(-126, 128, dtype=np.int32)
    found = np.array(power_of_two(mi.Int32(exponents)))
    np.testing.assert_array_equal(found, np.ldexp(1.0, exponents).astype(np.float32))


def test_reciprocals_are_exact() -> None:
    powers = np.ldexp(1.0, np.arange(-126, 127)).astype(np.float32)
    found = np.array(reciprocal_of_power(mi.Float(powers)))
    np.testing.assert_array_equal(found, 1.0 / powers)


@given(value=st.floats(2.0**-120, 2.0**120, width=32))
def test_the_smallest_power_that_reaches_a_number(value: float) -> None:
    exponent = int(ceil_log2(mi.Float(value))[0])
    assert math.ldexp(1.0, exponent - 1) < value <= math.ldexp(1.0, exponent)


def test_a_power_reaches_itself_and_no_more() -> None:
    exponents = np.arange(-125, 127, dtype=np.int32)
    powers = np.ldexp(1.0, exponents).astype(np.float32)
    np.testing.assert_array_equal(np.array(ceil_log2(mi.Float(powers))), exponents)
    above = np.nextafter(powers, np.float32(np.inf))
    np.testing.assert_array_equal(np.array(ceil_log2(mi.Float(above))), exponents + 1)
