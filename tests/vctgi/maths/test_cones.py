"""The moment rule turns a mean direction into the aperture of the cone that has it."""

from __future__ import annotations

import math

import mitsuba as mi
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctgi.maths.cones import aperture_from_mean_cosine, ratio_from_aperture

pytestmark = pytest.mark.usefixtures("variant")

NEAR_A_MIRROR = 2e-3
"""Radians: the arc cosine near 1 turns 6e-8 into an angle."""


@given(aperture=st.floats(0.01, 2.0 * math.pi))
def test_mean_of_an_even_cone_gives_its_aperture_back(aperture: float) -> None:
    mean_cosine = 0.5 * (1.0 + math.cos(0.5 * aperture))
    found = float(aperture_from_mean_cosine(mi.Float(mean_cosine))[0])
    assert found == pytest.approx(aperture, abs=NEAR_A_MIRROR, rel=1e-5)


def test_mirror_has_no_aperture() -> None:
    assert float(aperture_from_mean_cosine(mi.Float(1.0))[0]) == 0.0


def test_ratio_is_the_footprint_at_distance_one() -> None:
    assert ratio_from_aperture(0.5 * math.pi) == pytest.approx(2.0)
