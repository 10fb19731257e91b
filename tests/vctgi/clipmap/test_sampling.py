"""The reads equal their slow twins in every format; the optical depth is a bounded logarithm."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vctgi.hand_made_volumes import (
    emittance_of,
    homogeneous_volume,
    opacity_of,
    random_values,
)
from tests.vctgi.twins.reading import HostVolume
from tests.vctgi.twins.reading import read_medium as slow_read
from tests.vctgi.twins.reading import read_surface as slow_surface
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.sampling import OPTICAL_DEPTH_CAP, optical_depth, read_medium, read_surface
from vctgi.clipmap.storage import CODES, StorageConfig, VoxelVolume, pack_volume
from vctgi.clipmap.unpacking import unpack_level

pytestmark = pytest.mark.usefixtures("variant")

NEAR_OPAQUE_ROUNDING = 2e-3
"""Relative. At the cap 1 - opacity is 0.0025, and single precision knows it to 1e-7 / 0.0025; the
weights of a read add their own rounding before that."""

SINGLE_PRECISION = 1e-5

CONFIGS = [
    StorageConfig(format=name, direction_count=direction_count)  # type: ignore[arg-type]
    for name in CODES
    if name != "texture16"
    for direction_count in (6, 3, 1)
]
"""Every way of storing voxels in arrays."""


def layout() -> ClipmapLayout:
    return lay_out_clipmap((0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=2, resolution=8)


def random_rays(where: ClipmapLayout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels, points in and around the windows, and unit directions."""
    rng = np.random.default_rng(11)
    count = 200
    levels = rng.integers(0, len(where.levels), count)
    points = np.array(where.centre) + rng.uniform(-6.0, 6.0, (count, 3))
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return levels, points, directions


def on_device(
    levels: np.ndarray, points: np.ndarray, directions: np.ndarray
) -> tuple[mi.UInt32, mi.Point3f, mi.Vector3f]:
    return (
        mi.UInt32(levels.astype(np.uint32)),
        mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(directions.T, dtype=np.float32)),
    )


def stored_volume(config: StorageConfig) -> tuple[VoxelVolume, HostVolume]:
    """Return a random volume in a format, and what the format made of it."""
    where = layout()
    alphas, colors = random_values(where, seed=5)
    device = pack_volume(opacity_of(where, alphas), emittance_of(where, colors), config)
    if config == StorageConfig():
        return device, HostVolume(where, alphas, colors)
    stored = [unpack_level(device, level) for level in where.levels]
    shapes = [(6,) + (level.resolution,) * 3 for level in where.levels]
    alphas = [np.array(t.opacity).reshape(s) for t, s in zip(stored, shapes, strict=True)]
    colors = [np.array(t.emittance).T.reshape(*s, 3) for t, s in zip(stored, shapes, strict=True)]
    return device, HostVolume(where, alphas, colors)


@pytest.mark.parametrize("config", CONFIGS, ids=str)
def test_the_medium_equals_the_twin(config: StorageConfig) -> None:
    device, host = stored_volume(config)
    rays = random_rays(host.layout)
    medium = read_medium(device, *on_device(*rays))
    slow = [slow_read(host, int(level), p, d) for level, p, d in zip(*rays, strict=True)]
    extinction = np.array([e for e, _ in slow])
    source = np.array([s for _, s in slow])
    assert (extinction > 0.0).any()
    assert (extinction == 0.0).any()
    np.testing.assert_allclose(
        np.array(medium.extinction), extinction, rtol=NEAR_OPAQUE_ROUNDING, atol=SINGLE_PRECISION
    )
    np.testing.assert_allclose(
        np.array(medium.source).T, source, rtol=NEAR_OPAQUE_ROUNDING, atol=SINGLE_PRECISION
    )


@pytest.mark.parametrize("config", CONFIGS, ids=str)
def test_the_surface_equals_the_twin(config: StorageConfig) -> None:
    device, host = stored_volume(config)
    rays = random_rays(host.layout)
    radiance, opacity = read_surface(device, *on_device(*rays), mi.Bool(True))
    slow = [slow_surface(host, int(level), p, n) for level, p, n in zip(*rays, strict=True)]
    known = np.array([a for _, a in slow])
    np.testing.assert_allclose(np.array(opacity), known, rtol=1e-4, atol=SINGLE_PRECISION)
    assert (known == 0.0).any()
    # Where hardly anything is, the quotient of two small numbers is not told apart.
    solid = known > 1e-2
    assert solid.any()
    np.testing.assert_allclose(
        np.array(radiance).T[solid], np.array([c for c, _ in slow])[solid], rtol=1e-3
    )


def test_a_surface_is_not_read_where_it_is_not_asked_for() -> None:
    device, _ = stored_volume(StorageConfig())
    radiance, opacity = read_surface(device, *on_device(*random_rays(layout())), mi.Bool(False))
    assert not np.array(radiance).any()
    assert not np.array(opacity).any()


def test_homogeneous_medium_reads_its_extinction_at_every_level() -> None:
    where = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=3, resolution=16)
    extinction = 0.3
    volume = homogeneous_volume(where, extinction, radiance=2.0)
    for level in where.levels:
        medium = read_medium(
            volume, mi.UInt32(level.level), mi.Point3f(0.1, 0.2, -0.1), mi.Vector3f(0.0, 0.0, -1.0)
        )
        found = float(medium.extinction[0])
        # The last mips of so thick a fog meet the cap.
        expected = min(extinction, OPTICAL_DEPTH_CAP / level.voxel_size)
        assert found == pytest.approx(expected, rel=NEAR_OPAQUE_ROUNDING)
        assert float(medium.source[0][0]) == pytest.approx(2.0 * found, rel=SINGLE_PRECISION)


def test_outside_the_window_there_is_nothing() -> None:
    volume = homogeneous_volume(layout(), 0.5)
    medium = read_medium(
        volume, mi.UInt32(0), mi.Point3f(1e6, 0.0, 0.0), mi.Vector3f(1.0, 0.0, 0.0)
    )
    assert float(medium.extinction[0]) == 0.0
    assert not np.array(medium.source).any()


@given(opacity=st.floats(0.0, 1.0, width=32))
def test_optical_depth_is_the_capped_logarithm(opacity: float) -> None:
    depth, ratio = optical_depth(mi.Float(opacity))
    exact = OPTICAL_DEPTH_CAP if opacity == 1.0 else min(-math.log1p(-opacity), OPTICAL_DEPTH_CAP)
    # log(1 - a) in single precision knows a to 6e-8.
    assert float(depth[0]) == pytest.approx(exact, rel=NEAR_OPAQUE_ROUNDING, abs=1.2e-7)
    if opacity > 1e-3:
        assert float(ratio[0]) == pytest.approx(exact / opacity, rel=NEAR_OPAQUE_ROUNDING)
    assert 1.0 - 1e-3 <= float(ratio[0]) <= OPTICAL_DEPTH_CAP * 1.003
