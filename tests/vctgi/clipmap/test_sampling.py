"""The layered read equals its slow twin; the optical depth is a bounded logarithm."""

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
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.sampling import OPTICAL_DEPTH_CAP, optical_depth, read_medium
from vctgi.clipmap.storage import pack_volume

pytestmark = pytest.mark.usefixtures("variant")

NEAR_OPAQUE_ROUNDING = 2e-3
"""Relative. At the cap 1 - opacity is 0.0025, and single precision knows it to 1e-7 / 0.0025; the
weights of a read add their own rounding before that."""

SINGLE_PRECISION = 1e-5


def layout() -> ClipmapLayout:
    return lay_out_clipmap((0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=2, resolution=8)


def test_equals_the_twin() -> None:
    where = layout()
    alphas, colors = random_values(where, seed=5)
    device = pack_volume(opacity_of(where, alphas), emittance_of(where, colors))
    host = HostVolume(where, alphas, colors)
    rng = np.random.default_rng(11)
    count = 200
    levels = rng.integers(0, len(where.levels), count)
    points = np.array(where.centre) + rng.uniform(-6.0, 6.0, (count, 3))
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    medium = read_medium(
        device,
        mi.UInt32(levels.astype(np.uint32)),
        mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(directions.T, dtype=np.float32)),
    )
    slow = [
        slow_read(host, int(level), point, direction)
        for level, point, direction in zip(levels, points, directions, strict=True)
    ]
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
