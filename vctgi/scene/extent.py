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
    # One box in Mitsuba's memory: an array of each shape's corners takes a hundred times as long.
    whole = mi.ScalarBoundingBox3f()
    for shape in scene.shapes():
        box = shape.bbox()
        if box.valid():
            whole.expand(box)
        elif isinstance(shape, mi.Mesh):
            places = np.array(mi.traverse(shape)["vertex_positions"]).reshape(-1, 3)
            for corner in (places.min(axis=0), places.max(axis=0)):
                whole.expand(mi.ScalarPoint3f(corner.tolist()))
    if not whole.valid():
        nothing = np.zeros(3)
        return nothing, nothing
    low, high = (np.array(end, dtype=np.float64).ravel() for end in (whole.min, whole.max))
    return low, high
