"""Opacity voxelization equals its slow twin bit for bit, and covers every cell once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.vctgi.twins.voxelization import voxelize
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.slots import SlotRule
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.scene.triangles import is_degenerate
from vctgi.stages.voxelization.opacity import (
    DEFAULT_CONFIG,
    OpacityVoxelizationConfig,
    voxelize_opacity,
)

pytestmark = pytest.mark.usefixtures("variant")

VOXEL_SIZE = 0.25
CENTRE = (0.3, -5.0, 7.0)
"""Neither at the origin nor at a multiple of the voxel size: origins of both signs."""
RESOLUTION = 8
CELL = 1.0 / 8.0
"""Edge of a cell in voxels."""


def layout() -> ClipmapLayout:
    return lay_out_clipmap(
        CENTRE, finest_voxel_size=VOXEL_SIZE, level_count=2, resolution=RESOLUTION
    )


def in_window(voxels: np.ndarray) -> np.ndarray:
    """World points of places given in finest voxels from the corner of the finest window."""
    finest = layout().levels[0]
    world: np.ndarray = (np.asarray(voxels, float) + np.array(finest.origin)) * finest.voxel_size
    return world


def assert_equals_twin(
    vertices: np.ndarray, config: OpacityVoxelizationConfig = DEFAULT_CONFIG
) -> list[np.ndarray]:
    # The twin knows nothing of levels that finer windows cover.
    config = replace(config, is_complete=True)
    found = voxelize_opacity(opaque_surfaces(vertices), layout(), config)
    tables = []
    for level in layout().clip_levels:
        shape = (DIRECTION_COUNT,) + (level.resolution,) * 3
        table = np.array(found.levels[level.level], dtype=np.float64).reshape(shape)
        np.testing.assert_array_equal(table, voxelize(vertices, level, config))
        tables.append(table)
    return tables


# Corners up to half a window outside, on sixteenths of a voxel or anywhere.
_ANYWHERE = st.floats(-4.0, 12.0, width=32)
_ON_GRID = st.integers(-64, 192).map(lambda i: i / 16.0)


@settings(max_examples=40)
@given(
    corners=arrays(
        np.float64,
        st.tuples(st.integers(1, 3), st.just(3), st.just(3)),
        elements=st.one_of(_ANYWHERE, _ON_GRID),
    )
)
def test_random_triangles_equal_the_twin(corners: np.ndarray) -> None:
    vertices = in_window(corners)
    assume(not is_degenerate(vertices).any())
    assert_equals_twin(vertices)


CONFIGS = {
    "thin": OpacityVoxelizationConfig(slots=SlotRule(thickness_voxels=0.0)),
    "half a voxel": OpacityVoxelizationConfig(slots=SlotRule(thickness_voxels=0.5)),
    "thick everywhere": OpacityVoxelizationConfig(
        slots=SlotRule(thickness_voxels=1.7, sloped_below=2.0)
    ),
    "nothing is sloped": OpacityVoxelizationConfig(slots=SlotRule(sloped_below=0.0)),
    "two-sided": OpacityVoxelizationConfig(is_two_sided=True),
    "supersampled": OpacityVoxelizationConfig(max_supersampling=2),
}


@settings(max_examples=12)
@given(
    corners=arrays(
        np.float64,
        st.tuples(st.integers(1, 3), st.just(3), st.just(3)),
        elements=st.one_of(_ANYWHERE, _ON_GRID),
    )
)
@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS.keys())
def test_every_option_equals_the_twin(
    config: OpacityVoxelizationConfig, corners: np.ndarray
) -> None:
    vertices = in_window(corners)
    assume(not is_degenerate(vertices).any())
    assert_equals_twin(vertices, config)


SPECIAL = {
    "larger than the window": [[-900, 3, -700], [1000, 2, -600], [40, 5, 1100]],
    "smaller than a cell": [[3.05, 3.05, 3.05], [3.1, 3.06, 3.04], [3.05, 3.11, 3.08]],
    "edge-on to x": [[2.5, 1.0, 1.0], [6.5, 1.0, 1.0], [4.0, 6.0, 1.0]],
    "slightly sloped": [[0.2, 0.2, 3.9], [7.8, 0.3, 4.1], [3.0, 7.7, 4.05]],
    "on a voxel face": [[0, 0, 4], [8, 0, 4], [0, 8, 4]],
    "on a voxel face, seen from below": [[0, 0, 4], [0, 8, 4], [8, 0, 4]],
    "on the window's rim": [[0, 0, 8], [8, 0, 8], [0, 8, 8]],
    "one voxel before the window": [[0, 0, -0.5], [0, 8, -0.5], [8, 0, -0.6]],
    "needle": [[0.1, 0.2, 0.3], [7.9, 7.7, 7.8], [0.1, 0.2, 0.31]],
}


@pytest.mark.parametrize("corners", SPECIAL.values(), ids=SPECIAL.keys())
def test_special_triangles_equal_the_twin(corners: list[list[float]]) -> None:
    assert_equals_twin(in_window(np.array([corners])))


@pytest.mark.parametrize("distance", [1e3, 1e7, 1e12])
def test_far_triangles_leave_the_window_empty(distance: float) -> None:
    corners = np.array([[[0, 0, 0], [8, 1, 0], [2, 8, 3.0]]]) + np.array([distance, -distance, 0.0])
    for table in assert_equals_twin(in_window(corners)):
        assert not table.any()


@settings(max_examples=25)
@given(
    low=st.tuples(st.integers(0, 30), st.integers(0, 30)),
    extent=st.tuples(st.integers(1, 30), st.integers(1, 30)),
    depth=st.floats(0.1, 7.9),
    axis=st.integers(0, 2),
    is_other_diagonal=st.booleans(),
)
def test_quad_of_two_triangles_covers_each_of_its_cells_once(
    low: tuple[int, int],
    extent: tuple[int, int],
    depth: float,
    axis: int,
    is_other_diagonal: bool,
) -> None:
    # Edges run along cell edges, so that the cells of the quad are exactly known; the diagonal
    # runs through cell centres, which must neither be lost nor fall to one triangle alone.
    u, v = (axis + 1) % 3, (axis + 2) % 3
    quad = np.zeros((4, 3))
    for corner, (step_u, step_v) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
        quad[corner, axis] = depth
        quad[corner, u] = (low[0] + step_u * extent[0]) * CELL
        quad[corner, v] = (low[1] + step_v * extent[1]) * CELL
    faces = [[0, 1, 3], [1, 2, 3]] if is_other_diagonal else [[0, 1, 2], [0, 2, 3]]
    finest, _ = assert_equals_twin(in_window(quad[np.array(faces)]))
    # The normal points towards +axis: only rays that travel towards -axis meet the front.
    assert finest[2 * axis + 1].sum() * 64 == extent[0] * extent[1]
    assert finest.sum() == finest[2 * axis + 1].sum()


def test_overlapping_surfaces_are_counted_once() -> None:
    one = in_window(np.array([[[0, 0, 3.5], [8, 0, 3.5], [0, 8, 3.5]]]))
    once, _ = assert_equals_twin(one)
    other = one + np.array([0.0, 0.0, 0.01 * VOXEL_SIZE])
    twice, _ = assert_equals_twin(np.concatenate([one, other]))
    np.testing.assert_array_equal(once, twice)


def test_one_sided_surface_fills_only_slots_that_see_its_front() -> None:
    corners = np.array([[[0.5, 0.5, 2.0], [7.5, 0.5, 4.0], [0.5, 7.5, 5.0]]])
    normal = np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])
    finest, _ = assert_equals_twin(in_window(corners))
    for axis in range(3):
        seen, unseen = (0, 1) if normal[axis] < 0.0 else (1, 0)
        assert finest[2 * axis + seen].any()
        assert not finest[2 * axis + unseen].any()


def test_empty_scene_has_no_opacity() -> None:
    found = voxelize_opacity(opaque_surfaces(np.zeros((0, 3, 3))), layout())
    assert not any(np.array(level).any() for level in found.levels)
