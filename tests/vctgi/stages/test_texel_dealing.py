"""Texels are dealt to cells as NumPy deals them, all of them, and one at least to each cell."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from vctgi.stages.reflective_shadow_map.dealing import deal, dealt_count, owners, smoothed

pytestmark = pytest.mark.usefixtures("variant")


def dealt_by_numpy(weight: np.ndarray, texel_count: int) -> np.ndarray:
    weight = weight.astype(np.float64)
    if weight.sum() == 0.0:
        weight = np.ones(len(weight))
    spare = max(texel_count - len(weight), 0)
    ends = np.floor(np.cumsum(weight) * (spare / weight.sum()) + 0.5).astype(np.int64)
    shares: np.ndarray = 1 + np.diff(ends, prepend=0)
    return shares


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_deals_in_proportion(scale: float) -> None:
    rng = np.random.default_rng(3)
    weight = (rng.pareto(1.0, 4096) * (rng.random(4096) < 0.4)).astype(np.float32)
    weight *= np.float32(scale)
    dealt = np.array(deal(mi.Float(weight), 100_000)).astype(np.int64)
    assert dealt.sum() == dealt_count(4096, 100_000) == 100_000
    assert dealt.min() == 1
    # Single weights and fixed point may round a share the other way.
    assert np.abs(dealt - dealt_by_numpy(weight, 100_000)).max() <= 1


def test_equal_where_nothing_gets_through() -> None:
    np.testing.assert_array_equal(np.array(deal(mi.Float(np.zeros(8)), 64)), np.full(8, 8))


def test_one_each_where_there_are_too_few() -> None:
    dealt = deal(mi.Float(np.arange(8, dtype=np.float32)), 3)
    np.testing.assert_array_equal(np.array(dealt), np.ones(8))
    assert dealt_count(8, 3) == 8


def test_owners_repeat_cells() -> None:
    dealt = np.array([1, 3, 1, 7, 2], dtype=np.uint32)
    found = np.array(owners(mi.UInt32(dealt), int(dealt.sum())))
    np.testing.assert_array_equal(found, np.repeat(np.arange(5), dealt))


@pytest.mark.parametrize(("per_axis", "axis_count"), [(5, 2), (3, 4), (1, 2)])
def test_blurs_along_each_axis(per_axis: int, axis_count: int) -> None:
    weight = np.random.default_rng(1).random(per_axis**axis_count)
    grid = weight.reshape((per_axis,) * axis_count)
    for axis in range(axis_count):
        grid = 0.5 * grid + 0.25 * (np.roll(grid, 1, axis) + np.roll(grid, -1, axis))
    found = np.array(smoothed(mi.Float(weight.astype(np.float32)), per_axis, axis_count))
    np.testing.assert_allclose(found, grid.ravel(), rtol=1e-5)


@pytest.mark.parametrize("cell_count", [7, 81, 256, 13**4])
def test_grids_dealt_together_are_dealt_as_each_alone(cell_count: int) -> None:
    rng = np.random.default_rng(5)
    weights = [rng.random(cell_count).astype(np.float32) * scale for scale in (1.0, 0.0, 50.0)]
    counts = [3 * cell_count, 2 * cell_count, 4 * cell_count + 5]
    together = np.array(deal(mi.Float(np.concatenate(weights)), *counts)).reshape(3, -1)
    for found, weight, count in zip(together, weights, counts, strict=True):
        np.testing.assert_array_equal(found, np.array(deal(mi.Float(weight), count)))
