"""Texels are dealt to cells as NumPy deals them, all of them, and one at least to each cell."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from vctgi.stages.reflective_shadow_map.dealing import (
    deal,
    dealt_count,
    own_texels,
    owner,
    smoothed,
)

pytestmark = pytest.mark.usefixtures("variant")


def deal_each(weight: np.ndarray, *counts: int) -> np.ndarray:
    """Texels of each cell."""
    dealt = deal(mi.Float(weight), *counts)
    cell = dr.arange(mi.UInt32, len(weight))
    return np.array(own_texels(dealt, cell, len(weight) // len(counts)))


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
    dealt = deal_each(weight, 100_000).astype(np.int64)
    assert dealt.sum() == dealt_count(4096, 100_000) == 100_000
    assert dealt.min() == 1
    # Single weights and fixed point may round a share the other way.
    assert np.abs(dealt - dealt_by_numpy(weight, 100_000)).max() <= 1


def test_equal_where_nothing_gets_through() -> None:
    np.testing.assert_array_equal(deal_each(np.zeros(8), 64), np.full(8, 8))


def test_one_each_where_there_are_too_few() -> None:
    dealt = deal_each(np.arange(8, dtype=np.float32), 3)
    np.testing.assert_array_equal(dealt, np.ones(8))
    assert dealt_count(8, 3) == 8


def test_owners_repeat_cells() -> None:
    dealt = np.array([[1, 3, 1, 7, 2], [4, 1, 1, 1, 1]])
    up_to = mi.UInt32(np.cumsum(dealt, axis=1).ravel().astype(np.uint32))
    for grid, own in enumerate(dealt):
        texel = dr.arange(mi.UInt32, int(own.sum()))
        found = np.array(owner(up_to, mi.UInt32(grid), texel, len(own)))
        np.testing.assert_array_equal(found, grid * len(own) + np.repeat(np.arange(5), own))


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
    together = deal_each(np.concatenate(weights), *counts).reshape(3, -1)
    for found, weight, count in zip(together, weights, counts, strict=True):
        np.testing.assert_array_equal(found, deal_each(weight, count))
