"""Voxelization at any scale and place, of slivers and masks, and the same whatever the order."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vctgi.opacity_tables import METHODS, ROUNDING, tables, voxelize, window
from tests.vctgi.small_scenes import SceneDict
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.scene.surfaces import VoxelSurfaces, opaque_surfaces
from vctgi.stages.voxelization.opacity import (
    Coverage,
    OpacityVoxelizationConfig,
    voxelize_opacity,
)

pytestmark = [
    pytest.mark.usefixtures("variant"),
    pytest.mark.parametrize("method", METHODS),
]

SCALE_ROUNDING = 1e-4
"""Share of the slots that may change when a scale is no power of two: those where an edge or a
layer passes within rounding, 2^-53 of the coordinates, of a cell's centre."""

SLIVER_COUNT = 1_000_000
SLIVER_WIDTH = 1e-7
"""Voxels: below the tolerance of an edge, which then decides the coverage."""

SLIVER_GAIN = 5.0
"""Covered area of slivers, in their own area and that of a tolerance around their edges."""

TOLERANCE_VOXELS = 1e-6 / 8.0
"""How far outside an edge a cell still counts, voxels."""


MASK_TESTS = {"cells": 64, "samples": 8, "analytic": 64}
"""Places of a face at which a mask is asked whether it stops light."""


def soup(count: int = 200, seed: int = 21) -> np.ndarray:
    """Triangles across a window of 8 voxels, with coordinates of 20 binary places."""
    rng = np.random.default_rng(seed)
    corners: np.ndarray = np.round(rng.uniform(-1.0, 9.0, (count, 3, 3)) * 2.0**20) / 2.0**20
    return corners


def voxelize_scaled(
    corners: np.ndarray, method: Coverage, scale: float, offset: float = 0.0
) -> np.ndarray:
    """Opacities [direction, z, y, x] of the finest level, all lengths scaled and then moved."""
    layout = lay_out_clipmap(
        (4.0 * scale + offset,) * 3, finest_voxel_size=scale, level_count=2, resolution=8
    )
    return voxelize(corners * scale + offset, layout, method)[0]


@settings(max_examples=10)
@given(exponent=st.integers(-40, 40))
def test_scaling_by_a_power_of_two_changes_no_bit(method: Coverage, exponent: int) -> None:
    expected = voxelize_scaled(soup(), method, 1.0)
    np.testing.assert_array_equal(voxelize_scaled(soup(), method, 2.0**exponent), expected)


@pytest.mark.parametrize("scale", [1e-4, 1e6])
def test_scaling_changes_no_more_than_rounding(scale: float, method: Coverage) -> None:
    expected, found = (voxelize_scaled(soup(), method, s) for s in (1.0, scale))
    is_changed = np.abs(found - expected) > 1e-6
    assert np.count_nonzero(is_changed) <= SCALE_ROUNDING * np.count_nonzero(expected)


@pytest.mark.parametrize("offset", [1e5, -1e5, 2.0**24])
def test_far_from_the_origin_nothing_changes(offset: float, method: Coverage) -> None:
    # 20 binary places beside 25 before the point: exact in double precision.
    expected = voxelize_scaled(soup(), method, 1.0)
    found = voxelize_scaled(soup(), method, 1.0, offset)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING[method])


def test_single_precision_far_away_loses_what_the_vertices_lose(method: Coverage) -> None:
    offset = 1e5
    rounded = (soup() + offset).astype(np.float32).astype(np.float64) - offset
    expected = voxelize_scaled(rounded, method, 1.0)
    found = voxelize_scaled(rounded, method, 1.0, offset)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING[method])


def slivers() -> np.ndarray:
    """Needles of about a voxel's length in every direction."""
    rng = np.random.default_rng(22)
    start = rng.uniform(0.0, 8.0, (SLIVER_COUNT, 3))
    along = rng.normal(size=(SLIVER_COUNT, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, rng.normal(size=(SLIVER_COUNT, 3)))
    aside *= SLIVER_WIDTH / np.linalg.norm(aside, axis=1, keepdims=True)
    return np.stack([start, start + along, start + aside], axis=1)


def test_a_million_slivers_cover_no_more_than_their_rims(
    method: Coverage, record_property: Callable[[str, object], None]
) -> None:
    corners = slivers()
    begun = time.perf_counter()
    table = voxelize(corners, window(), method)[0]
    record_property(f"seconds for {SLIVER_COUNT} slivers", time.perf_counter() - begun)
    assert np.isfinite(table).all()
    # Seen along three axes, thickened to two layers; a rim of the tolerance around each.
    area = SLIVER_COUNT * (0.5 * SLIVER_WIDTH + 2.0 * TOLERANCE_VOXELS)
    assert table.sum() <= SLIVER_GAIN * 2.0 * area


def test_nothing_in_reach_leaves_every_level_empty(method: Coverage) -> None:
    for corners in (np.zeros((0, 3, 3)), soup() + 1e4, soup() - 1e9):
        for table in voxelize(corners, window(level_count=3), method):
            assert not table.any()


@contextmanager
def thread_count(count: int) -> Iterator[None]:
    """Let the CPU back end use this many threads."""
    before = dr.thread_count()
    dr.set_thread_count(count)
    try:
        yield
    finally:
        dr.set_thread_count(before)


def test_neither_threads_nor_the_order_of_triangles_change_a_bit(method: Coverage) -> None:
    corners = soup(3000)
    expected = voxelize(corners, window(level_count=2), method)
    order = np.random.default_rng(23).permutation(len(corners))
    found = [voxelize(corners[order], window(level_count=2), method)]
    for count in (1, 2, 5):
        with thread_count(count):
            found.append(voxelize(corners, window(level_count=2), method))
    for again in found:
        for table, same in zip(again, expected, strict=True):
            np.testing.assert_array_equal(table, same)


def masked_square(opacity: SceneDict | float, depth: float = 3.5) -> VoxelSurfaces:
    """Return a square across the window of 8 voxels, texture coordinates 0 to 1, and its mask."""
    outline = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    uv = outline[[[0, 1, 2], [0, 2, 3]]]
    surfaces = opaque_surfaces(np.concatenate([8.0 * uv, np.full((2, 3, 1), depth)], axis=-1))
    mask = mi.load_dict({"type": "mask", "opacity": opacity, "bsdf": {"type": "diffuse"}})
    surfaces.uv, surfaces.mask_index, surfaces.masks = uv, np.zeros(2, int), [mask]
    return surfaces


def checker(squares_per_voxel: int) -> SceneDict:
    """Return a texture of opaque and clear squares over the window of 8 voxels."""
    scale = mi.ScalarTransform3f().scale([4.0 * squares_per_voxel] * 2)
    return {"type": "checkerboard", "color0": 0.0, "color1": 1.0, "to_uv": scale}


def test_mask_of_whole_voxels_is_exact(method: Coverage) -> None:
    table = voxelize(masked_square(checker(1)), window(), method)[0]
    place = np.add.outer(np.arange(8), np.arange(8)) % 2
    assert set(np.unique(table[5, 3])) == {0.0, 1.0}
    assert np.ptp(table[5, 3][place == 0]) == np.ptp(table[5, 3][place == 1]) == 0.0
    assert table.sum() == 32.0


def test_mask_of_cells_covers_half_of_each_voxel(method: Coverage) -> None:
    # A square of the mask is one of the 8 x 8 cells of a voxel's face.
    table = voxelize(masked_square(checker(8)), window(), method)[0]
    np.testing.assert_array_equal(table[5, 3], np.full((8, 8), 0.5))


@pytest.mark.parametrize("opacity", [0.0, 0.02, 0.3, 0.5, 0.97, 1.0])
def test_grey_masks_cover_their_opacity_on_average(opacity: float, method: Coverage) -> None:
    shares = []
    for depth in np.arange(8) + 0.5:
        table = voxelize(masked_square(opacity, depth), window(), method)[0]
        shares.append(table[5, int(depth)].mean())
        assert table.sum() == table[5, int(depth)].sum()
    # Masks are dithered test by test: the deviation of a Bernoulli mean, and 4 of them.
    test_count = len(shares) * 8**2 * MASK_TESTS[method]
    deviation = np.sqrt(opacity * (1.0 - opacity) / test_count)
    assert abs(np.mean(shares) - opacity) <= 4.0 * deviation


def test_a_picture_as_mask_covers_its_mean(method: Coverage) -> None:
    alpha = np.random.default_rng(24).uniform(size=(16, 16, 1)).astype(np.float32)
    texture = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(alpha),
        "raw": True,
        "filter_type": "nearest",
    }
    table = voxelize(masked_square(texture), window(), method)[0]
    deviation = np.sqrt(float(np.mean(alpha * (1.0 - alpha))) / (8**2 * MASK_TESTS[method]))
    assert abs(table[5, 3].mean() - alpha.mean()) <= 4.0 * deviation


def test_two_sided_opacity_fills_both_slots_alike(method: Coverage) -> None:
    config = OpacityVoxelizationConfig(coverage=method, is_two_sided=True, is_complete=True)
    table = tables(voxelize_opacity(opaque_surfaces(soup(20)), window(), config))[0]
    assert table.any()
    np.testing.assert_array_equal(table[::2], table[1::2])
