"""Area of a triangle within a box, by cutting it with one plane after the other."""

from __future__ import annotations

import numpy as np


def clipped_area(triangle: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    """Area on the first two axes of the part of a triangle [corner, axis] within a box.

    The box is open above: a triangle on its upper face is not in it. Two axes or three.
    """
    polygon = triangle
    for axis in range(triangle.shape[1]):
        polygon = clip(polygon, axis, low[axis], is_lower=True)
        polygon = clip(polygon, axis, high[axis], is_lower=False)
    return area(polygon)


def clip(polygon: np.ndarray, axis: int, limit: float, *, is_lower: bool) -> np.ndarray:
    """Keep what lies at and above a lower limit, or below an upper one [Sutherland-Hodgman]."""
    kept: list[np.ndarray] = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        is_kept_a, is_kept_b = (
            (end[axis] >= limit) if is_lower else (end[axis] < limit) for end in (a, b)
        )
        if is_kept_a:
            kept.append(a)
        if is_kept_a != is_kept_b:
            cut = a + (b - a) * ((limit - a[axis]) / (b[axis] - a[axis]))
            cut[axis] = limit
            kept.append(cut)
    return np.array(kept).reshape(-1, polygon.shape[1])


def area(polygon: np.ndarray) -> float:
    """Area of a polygon on the first two axes, taken from its first corner."""
    if len(polygon) < 3:
        return 0.0
    x, y = (polygon - polygon[0])[:, :2].T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))
