"""Chosen texels are texels, and in the mean what is interpolated; choices are shared out evenly."""

from __future__ import annotations

import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.clipmap.test_sampling import CONFIGS, layout, on_device, random_rays, stored_volume
from tests.vctgi.clipmap.test_texture import both
from tests.vctgi.twins.downsampling import address, is_held
from tests.vctgi.twins.reading import HostVolume
from vctgi.clipmap.sampling import read_medium, read_sample
from vctgi.clipmap.storage import StorageConfig
from vctgi.clipmap.texel_choice import TexelChoice, random_choice

pytestmark = pytest.mark.usefixtures("variant")

SINGLE_PRECISION = 1e-5

NEAR_OPAQUE_ROUNDING = 2e-3
"""As in test_sampling.py."""


def chosen_slots(
    host: HostVolume, level: int, point: np.ndarray, direction: np.ndarray, offset: np.ndarray
) -> list[tuple[float, float, np.ndarray]]:
    """Share, opacity and emittance of the one voxel of each axis that an offset chooses."""
    window = host.layout.levels[level]
    voxel = np.floor(point / window.voxel_size - 0.5 + offset).astype(int)
    if not is_held(voxel, window):
        return []
    slots = [2 * axis + int(direction[axis] < 0.0) for axis in range(3)]
    wheres = [(slot, *address(voxel, window)) for slot in slots]
    return [
        (abs(direction[axis]), host.alphas[level][where], host.colors[level][where])
        for axis, where in enumerate(wheres)
    ]


@pytest.mark.parametrize("config", [CONFIGS[0], CONFIGS[3]], ids=str)
def test_an_offset_chooses_one_voxel(config: StorageConfig) -> None:
    device, host = stored_volume(config)
    rays = random_rays(host.layout)
    offsets = np.random.default_rng(2).random((len(rays[0]), 3))
    choice = TexelChoice(mi.Float(0.0), mi.Point3f(np.float32(offsets.T)))
    found = read_sample(device.choosing(choice), *on_device(*rays), "projected")
    slow = [
        chosen_slots(host, int(lv), p, d, o) for lv, p, d, o in zip(*rays, offsets, strict=True)
    ]
    opacity = [min(sum(share * alpha for share, alpha, _ in each), 1.0) for each in slow]
    emitted = [sum((share * c for share, _, c in each), np.zeros(3)) for each in slow]
    assert np.any(opacity)
    assert not np.all(opacity)
    np.testing.assert_allclose(np.array(found.opacity), opacity, atol=SINGLE_PRECISION)
    np.testing.assert_allclose(np.array(found.emittance).T, emitted, atol=SINGLE_PRECISION)


def test_the_mean_over_all_offsets_is_the_interpolation() -> None:
    device, host = stored_volume(StorageConfig())
    levels, points, directions = random_rays(host.layout)
    # On the lattice of n offsets a voxel is chosen in exactly the share of its linear weight.
    n = 4
    for level in host.layout.levels:
        size = level.voxel_size
        points[levels == level.level] = (
            size * np.round(points[levels == level.level] / size * n) / n
        )
    rays = on_device(levels, points, directions)
    opacity, emitted = np.zeros(len(levels)), np.zeros((len(levels), 3))
    for each in itertools.product((np.arange(n) + 0.5) / n, repeat=3):
        offset = [dr.opaque(mi.Float, number) for number in each]
        choice = TexelChoice(mi.Float(0.0), mi.Point3f(*offset))
        found = read_sample(device.choosing(choice), *rays, "normalised")
        opacity += np.array(found.opacity) / n**3
        emitted += np.array(found.emittance).T / n**3
    linear = read_sample(device, *rays, "normalised")
    np.testing.assert_allclose(opacity, np.array(linear.opacity), atol=SINGLE_PRECISION)
    np.testing.assert_allclose(emitted, np.array(linear.emittance).T, atol=SINGLE_PRECISION)


def test_a_choice_of_levels_alone_interpolates_between_texels() -> None:
    device, host = stored_volume(StorageConfig())
    rays = on_device(*random_rays(host.layout))
    only_level = device.choosing(TexelChoice(mi.Float(0.7), None))
    media = [read_medium(each, *rays) for each in (only_level, device)]
    samples = [read_sample(each, *rays, "squared") for each in (only_level, device)]
    for found, expected in (
        [np.array(each.extinction) for each in media],
        [np.array(each.source) for each in media],
        [np.array(each.opacity) for each in samples],
        [np.array(each.emittance) for each in samples],
    ):
        np.testing.assert_array_equal(found, expected)


def test_a_texture_gives_the_same_texels() -> None:
    texture, arrays = both(6)
    rays = random_rays(layout())
    offsets = np.random.default_rng(3).random((3, len(rays[0])))
    choice = TexelChoice(mi.Float(0.0), mi.Point3f(np.float32(offsets)))
    found, expected = (
        read_sample(volume.choosing(choice), *on_device(*rays), "projected")
        for volume in (texture, arrays)
    )
    # At the centre of a texel neighbours weigh what rounding gives them.
    bound = 2.0 * texture.texels.weight_error() + 2.0**-10  # type: ignore[attr-defined]
    assert np.abs(np.array(found.opacity) - np.array(expected.opacity)).max() <= 3.0 * bound


@pytest.mark.parametrize("count", [6, 17, 64])
def test_the_cones_of_a_point_share_the_choices_out(count: int) -> None:
    points = 64
    lane = dr.arange(mi.UInt32, points * count)
    choice = random_choice(lane // count, lane % count, "random_texel")
    assert choice is not None
    assert choice.offset is not None
    # A Kronecker sequence of a quadratic number leaves no gap much wider than 1 / count.
    gaps = np.diff(np.sort(np.array(choice.level).reshape(points, count), axis=1), axis=1)
    assert gaps.max() < 3.0 / count
    for numbers in (choice.level, *choice.offset):
        values = np.array(numbers).reshape(points, count)
        assert values.min() >= 0.0
        assert values.max() < 1.0
        assert np.abs(values.mean(axis=1) - 0.5).max() < 1.0 / np.sqrt(count)
        # Points differ, by numbers that are even over them.
        starts = np.sort(values[:, 0])
        assert np.abs(starts - (np.arange(points) + 0.5) / points).max() < 1.63 / np.sqrt(points)


def test_nothing_is_chosen_where_all_is_interpolated() -> None:
    assert random_choice(mi.UInt32(3), mi.UInt32(0), "linear") is None
    choice = random_choice(mi.UInt32(3), mi.UInt32(0), "random_level")
    assert choice is not None
    assert choice.offset is None
