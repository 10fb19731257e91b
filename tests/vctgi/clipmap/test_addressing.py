"""A window of voxels and its storage are in one-to-one correspondence, wherever the window lies."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vctgi.clipmap.addressing import (
    is_inside,
    level_table,
    texel_from_voxel,
    voxel_from_position,
    voxel_from_texel,
)
from vctgi.clipmap.levels import LevelLayout, lay_out_clipmap

pytestmark = pytest.mark.usefixtures("variant")

_COORDINATE = st.integers(-(2**30), 2**30)


@settings(max_examples=40)
@given(origin=st.tuples(_COORDINATE, _COORDINATE, _COORDINATE), power=st.integers(2, 4))
def test_window_maps_one_to_one_onto_texels(origin: tuple[int, int, int], power: int) -> None:
    resolution = 2**power
    level = LevelLayout(level=0, voxel_size=1.0, resolution=resolution, origin=origin)
    texel = dr.arange(mi.UInt32, level.voxel_count)
    voxel = voxel_from_texel(texel, level)
    assert dr.all(is_inside(voxel, level))
    assert dr.all(texel_from_voxel(voxel, resolution) == texel)
    rows = np.array(voxel).T
    assert len(np.unique(rows, axis=0)) == level.voxel_count
    np.testing.assert_array_equal(rows.min(axis=0), origin)
    np.testing.assert_array_equal(rows.max(axis=0), np.array(origin) + resolution - 1)


@given(voxel=st.tuples(_COORDINATE, _COORDINATE, _COORDINATE), power=st.integers(2, 8))
def test_texel_is_the_voxel_modulo_the_resolution(voxel: tuple[int, int, int], power: int) -> None:
    resolution = 2**power
    x, y, z = (coordinate % resolution for coordinate in voxel)
    found = texel_from_voxel(mi.Vector3i(*voxel), resolution)
    assert int(found[0]) == (z * resolution + y) * resolution + x


def test_position_on_a_negative_side_falls_into_the_lower_voxel() -> None:
    level = LevelLayout(level=0, voxel_size=0.5, resolution=8, origin=(-4, -4, -4))
    found = voxel_from_position(mi.Point3f(-0.01, 0.0, 0.74), level)
    assert [int(found[i][0]) for i in range(3)] == [-1, 0, 1]


def test_table_is_the_layout() -> None:
    layout = lay_out_clipmap((9.0, -8.0, 7.0), finest_voxel_size=0.5, level_count=3, resolution=16)
    table = level_table(layout)
    rows = np.array(table.windows).reshape(-1, 4)
    for row, level in zip(rows, layout.levels, strict=True):
        assert tuple(row) == (*level.origin, level.resolution)
    np.testing.assert_array_equal(np.array(table.voxel_offsets), layout.voxel_offsets)
