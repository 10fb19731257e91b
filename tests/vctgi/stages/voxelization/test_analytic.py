"""Analytic coverage equals polygons clipped one by one, and adds up to each triangle's area."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.vctgi.twins.clipping import clipped_area
from vctgi.clipmap.levels import LevelLayout, lay_out_clipmap
from vctgi.clipmap.slots import BEHIND_NUDGE, SlotRule
from vctgi.maths.directions import DIRECTION_COUNT, other_axes
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.scene.triangles import is_degenerate
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig, voxelize_opacity
from vctgi.stages.voxelization.triangles import unit_normals

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 8

ROUNDING = 1e-6
"""Opacity is kept in single precision, areas in units of 2^-32 faces."""


def window() -> LevelLayout:
    return lay_out_clipmap(
        (0.3, -5.0, 7.0), finest_voxel_size=0.25, level_count=1, resolution=RESOLUTION
    ).levels[0]


def analytic(vertices: np.ndarray, rule: SlotRule) -> np.ndarray:
    """Opacity [direction, z, y, x] of the window, its storage unrolled."""
    level = window()
    layout = lay_out_clipmap(
        (0.3, -5.0, 7.0), finest_voxel_size=0.25, level_count=1, resolution=RESOLUTION
    )
    config = OpacityVoxelizationConfig(coverage="analytic", slots=rule)
    found = np.array(voxelize_opacity(opaque_surfaces(vertices), layout, config).levels[0])
    table = found.astype(np.float64).reshape((DIRECTION_COUNT,) + (RESOLUTION,) * 3)
    x, y, z = level.origin
    unrolled: np.ndarray = np.roll(table, (-z, -y, -x), axis=(1, 2, 3))
    return unrolled


def twin(vertices: np.ndarray, rule: SlotRule) -> np.ndarray:
    """Return the same, polygon by polygon."""
    level = window()
    covered = np.zeros((DIRECTION_COUNT,) + (RESOLUTION,) * 3)
    for triangle, normal in zip(vertices, unit_normals(vertices), strict=True):
        place = triangle / level.voxel_size - np.array(level.origin)
        for axis in range(3):
            if normal[axis] == 0.0:
                continue
            is_sloped = np.float32(abs(normal[axis])) < np.float32(rule.sloped_below)
            thickness = rule.thickness_voxels if is_sloped else 0.0
            behind = 1 if normal[axis] < 0.0 else -1
            u, v = other_axes(axis)
            seen = place[:, [u, v, axis]]
            seen = seen + np.array([0.0, 0.0, behind * BEHIND_NUDGE])
            for voxel in np.ndindex(RESOLUTION, RESOLUTION, RESOLUTION):
                low = np.array(voxel, float)[[u, v, axis]]
                high = low + 1.0
                if behind > 0:
                    low[2] -= thickness
                else:
                    high[2] += thickness
                x, y, z = voxel
                slot = 2 * axis + (0 if behind > 0 else 1)
                covered[slot, z, y, x] += clipped_area(seen, low, high)
    return np.minimum(covered, 1.0)


RULES = [
    SlotRule(),
    SlotRule(thickness_voxels=0.0),
    SlotRule(thickness_voxels=1.7, sloped_below=2.0),
]


@settings(max_examples=15)
@given(
    corners=arrays(np.float64, (2, 3, 3), elements=st.floats(-3.0, 11.0, width=32)),
    rule=st.sampled_from(RULES),
)
def test_equals_polygons_clipped_one_by_one(corners: np.ndarray, rule: SlotRule) -> None:
    level = window()
    vertices = (corners + np.array(level.origin)) * level.voxel_size
    assume(not is_degenerate(vertices).any())
    np.testing.assert_allclose(analytic(vertices, rule), twin(vertices, rule), atol=ROUNDING)


def test_thin_coverage_adds_up_to_the_projected_area() -> None:
    level = window()
    corners = np.array([[[1.3, 2.1, 1.7], [6.2, 3.3, 4.9], [2.4, 6.6, 5.3]]])
    table = analytic(
        (corners + np.array(level.origin)) * level.voxel_size, SlotRule(thickness_voxels=0.0)
    )
    cross = np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])
    found = table.sum(axis=(1, 2, 3)).reshape(3, 2).sum(axis=1)
    np.testing.assert_allclose(found, 0.5 * np.abs(cross), rtol=ROUNDING)
