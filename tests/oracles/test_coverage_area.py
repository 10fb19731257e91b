"""Oracle 7: coverage of a triangle clipped to a voxel face is the polygon's area."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.vctgi.twins.clipping import area, clipped_area
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.stages.voxelization.opacity import voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 16

LARGEST_ERROR = 0.125
"""Of 64 cells: each of the eight rows of a convex polygon is right to half a cell at either end."""

RMS_ERROR = 0.015
"""Measured 0.008 over partly covered faces, where cells that an edge crosses err either way."""

BIAS = 0.004
"""Cell centres favour neither side of an edge."""


def face_area(triangle: np.ndarray, x: int, y: int) -> float:
    """Area of a triangle [corner, 2] within the unit square whose lowest corner is (x, y)."""
    low = np.array([x, y], dtype=float)
    return clipped_area(triangle, low, low + 1.0)


def coverage(
    triangle: np.ndarray, resolution: int = RESOLUTION, extent: float = 16.0
) -> np.ndarray:
    """Opacity [y, x] that rays along z meet, of a flat triangle [corner, (x, y)] from below."""
    layout = lay_out_clipmap(
        (0.5 * extent,) * 3,
        finest_voxel_size=extent / resolution,
        level_count=1,
        resolution=resolution,
    )
    corners = np.concatenate([triangle, np.full((3, 1), 0.5 * extent + 0.1)], axis=1)
    found = voxelize_opacity(opaque_surfaces(corners[None]), layout).levels[0]
    table = np.array(found).reshape(DIRECTION_COUNT, resolution, resolution, resolution)
    # Storage is toroidal, and the window starts at the origin.
    assert layout.levels[0].origin == (0, 0, 0)
    both: np.ndarray = table[4:].sum(axis=(0, 1))
    return both


def test_clipper_itself_is_exact() -> None:
    square = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])
    assert face_area(square, 0, 0) == pytest.approx(1.0)
    assert face_area(square, 1, 0) == pytest.approx(0.5)
    assert face_area(square, 1, 1) == 0.0


def test_faces_hold_the_clipped_area() -> None:
    rng = np.random.default_rng(8)
    errors = []
    for _ in range(12):
        triangle = rng.uniform(-2.0, 18.0, (3, 2))
        found = coverage(triangle)
        exact = np.array(
            [[face_area(triangle, x, y) for x in range(RESOLUTION)] for y in range(RESOLUTION)]
        )
        is_partial = (exact > 0.0) & (exact < 1.0)
        assert np.all(found[exact > 1.0 - 1e-12] == 1.0)
        assert not found[exact == 0.0].any()
        errors.append((found - exact)[is_partial])
    error = np.concatenate(errors)
    assert np.abs(error).max() <= LARGEST_ERROR
    assert math.sqrt(float(np.mean(error**2))) <= RMS_ERROR
    assert abs(float(error.mean())) <= BIAS


def test_covered_area_converges_as_voxels_shrink() -> None:
    rng = np.random.default_rng(3)
    triangles = [rng.uniform(1.0, 15.0, (3, 2)) for _ in range(6)]
    resolutions = [8, 16, 32, 64]
    rms = []
    for resolution in resolutions:
        face = (16.0 / resolution) ** 2
        error = [coverage(t, resolution).sum() * face - area(t) for t in triangles]
        rms.append(math.sqrt(float(np.mean(np.square(error)))))
    slope = np.polyfit(np.log2(resolutions), np.log2(rms), 1)[0]
    # Counting cell centres converges at least linearly in the width of a cell.
    assert slope <= -1.0
