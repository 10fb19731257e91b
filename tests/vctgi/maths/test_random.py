"""The hash of an index is uniform, and its streams are independent."""

from __future__ import annotations

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.evenness import COUNT, deviation
from vctgi.maths.directions import random_unit

pytestmark = pytest.mark.usefixtures("variant")

CHANCE = 5.0
"""Standard deviations of chi-squared; the hash is fixed, so this fails always or never."""


def streams() -> list[np.ndarray]:
    """Numbers of the first streams and of some that the cones use."""
    index = dr.arange(mi.UInt32, COUNT)
    return [np.array(random_unit(index, s), np.float64) for s in (0, 1, 2, 3, 100, 200, 201)]


def test_random_numbers_are_uniform() -> None:
    for column in streams():
        assert column.min() >= 0.0
        assert column.max() < 1.0
        assert abs(deviation([column], 64)) < CHANCE


def test_streams_of_random_numbers_are_independent() -> None:
    for pair in itertools.combinations(streams(), 2):
        assert abs(deviation(list(pair), 32)) < CHANCE


def test_neighbours_have_independent_random_numbers() -> None:
    for column in streams():
        assert abs(deviation([column, np.roll(column, 1)], 32)) < CHANCE
