"""How large a scene is."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np


def half_extent(scene: mi.Scene, window: float = math.inf) -> mi.Float:
    """Return half the longest edge of a scene's bounds, world units, as no kernel's constant.

    Parameters
    ----------
    scene
        The scene.
    window
        Edge of the part of it that is shown, if that is less: a ground a million times as large
        must not push rays out of a room.
    """
    return dr.opaque(mi.Float, half_extent_number(scene, window))


def half_extent_number(scene: mi.Scene, window: float = math.inf) -> float:
    """Return `half_extent` as a number of the host."""
    low, high = scene_bounds(scene)
    return 0.5 * min(float(np.max(high - low)), window)


def longest_edge(scene: mi.Scene) -> float:
    """Return the longest edge of a scene's bounds, world units, in single precision."""
    low, high = scene_bounds(scene)
    return float(np.float32(np.max(high - low)))


def scene_bounds(scene: mi.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner of a scene's bounds, [3] each, world units.

    Mitsuba 3.9 gives a mesh that it merged of several rectangles no bounds, and so none to a scene
    of nothing else; those of its vertices take their place.
    """
    corners = [_bounds_of(shape) for shape in scene.shapes()]
    if not corners:
        nothing = np.zeros(3)
        return nothing, nothing
    low, high = (np.array(each) for each in zip(*corners, strict=True))
    return low.min(axis=0), high.max(axis=0)


def _bounds_of(shape: mi.Shape) -> tuple[np.ndarray, np.ndarray]:
    box = shape.bbox()
    if box.valid() or not isinstance(shape, mi.Mesh):
        low, high = (np.array(end, dtype=np.float64).ravel() for end in (box.min, box.max))
        return low, high
    places = np.array(mi.traverse(shape)["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    return places.min(axis=0), places.max(axis=0)
