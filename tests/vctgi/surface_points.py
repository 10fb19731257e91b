"""Chosen points on surfaces, so that a law can be tested without a camera."""

from __future__ import annotations

import numpy as np


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
