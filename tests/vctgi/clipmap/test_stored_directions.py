"""Directions that hold nothing, or all the same, are not stored, and every read stays as it was."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.clipmap.test_sampling import layout, on_device, random_rays
from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from vctgi.clipmap.sampling import read_medium, read_sample, read_surface
from vctgi.clipmap.storage import StorageConfig, VoxelVolume, pack_volume
from vctgi.clipmap.stored_directions import (
    SAME,
    SIX,
    StoredDirections,
    directions_of,
    facing_directions,
)

pytestmark = pytest.mark.usefixtures("variant")

FACED = [
    (True, False, False, True, False, False),
    (True, True, False, True, True, True),
]
"""Which directions hold anything."""

FORMATS = [StorageConfig(format="float32"), StorageConfig(format="rgb10a2")]
"""A texel a slot, and opacities of three slots in a word."""


def readings(volume: VoxelVolume) -> list[np.ndarray]:
    rays = on_device(*random_rays(volume.layout))
    medium = read_medium(volume, *rays)
    sample = read_sample(volume, *rays, "squared")
    radiance, opacity = read_surface(volume, *rays, mi.Bool(True))
    parts = (medium.extinction, medium.source, sample.opacity, sample.emittance, radiance, opacity)
    return [np.array(part) for part in parts]


def both(
    config: StorageConfig, values: tuple[list[np.ndarray], ...], directions: StoredDirections
) -> tuple[VoxelVolume, VoxelVolume]:
    """Return voxels with six directions stored, and with those."""
    where = layout()
    parts = opacity_of(where, values[0]), emittance_of(where, values[1])
    return pack_volume(*parts, config), pack_volume(*parts, config, directions)


@pytest.mark.parametrize("config", FORMATS, ids=lambda config: config.format)
@pytest.mark.parametrize("faced", FACED, ids=str)
def test_empty_directions_are_not_missed(config: StorageConfig, faced: tuple[bool, ...]) -> None:
    values = random_values(layout(), seed=3)
    for level in (*values[0], *values[1]):
        level[~np.array(faced)] = 0.0
    six, fewer = both(config, values, facing_directions(faced))
    for first, second in zip(readings(six), readings(fewer), strict=True):
        assert np.array_equal(first, second)
    assert fewer.byte_count < six.byte_count


@pytest.mark.parametrize("config", FORMATS, ids=lambda config: config.format)
def test_directions_that_are_all_alike_are_stored_once(config: StorageConfig) -> None:
    values = random_values(layout(), seed=3)
    for level in (*values[0], *values[1]):
        level[:] = level[:1]
    six, one = both(config, values, SAME)
    for first, second in zip(readings(six), readings(one), strict=True):
        assert np.array_equal(first, second)
    assert one.byte_count < six.byte_count


def test_layouts_name_the_direction_that_each_place_holds() -> None:
    assert SIX.sources == [0, 1, 2, 3, 4, 5]
    assert directions_of(3).slots == (0, 0, 1, 1, 2, 2)
    assert SAME.sources == [0]
    some = facing_directions((True, False, False, True, False, False))
    assert some.slots == (0, None, None, 1, None, None)
    assert some.sources == [0, 3]
    assert [some.has_axis(axis) for axis in range(3)] == [True, True, False]
    nothing = facing_directions((False,) * 6)
    assert nothing.count == 1
