"""G-buffers of chosen points, so that a law can be tested without a camera."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.scene.records import GBuffer


def surface_points(positions: np.ndarray, normals: np.ndarray) -> GBuffer:
    """Return points [n, 3] of white diffuse surfaces, seen along their normals."""
    count = len(positions)
    position = mi.Point3f(np.ascontiguousarray(positions.T, dtype=np.float32))
    normal = mi.Vector3f(np.ascontiguousarray(normals.T, dtype=np.float32))
    nothing = dr.zeros(mi.Color3f, count)
    return GBuffer(
        sample_index=dr.arange(mi.UInt32, count),
        is_valid=dr.full(mi.Bool, True, count),
        position=position,
        normal=normal,
        ray_direction=-normal,
        depth=dr.full(mi.Float, 1.0, count),
        albedo=nothing + 1.0,
        specular_albedo=nothing,
        specular_axis=normal,
        specular_aperture=dr.zeros(mi.Float, count),
        passed=nothing,
    )


def points_in_room(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random points on the inner faces of the cube from -1 to 1, and their normals [n, 3]."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (count, 3))
    face = rng.integers(0, 6, count)
    side = np.where(face % 2 == 0, 1.0, -1.0)
    rows = np.arange(count)
    points[rows, face // 2] = side
    normals = np.zeros((count, 3))
    normals[rows, face // 2] = -side
    return points, normals
