"""Parts of small scenes for the tests of the renderer, as Mitsuba dictionaries."""

from __future__ import annotations

import math
from typing import Any

import mitsuba as mi
import numpy as np

SceneDict = dict[str, Any]

INWARD_TURNS = [
    ([0, 1, 0], 0.0),
    ([0, 1, 0], 90.0),
    ([0, 1, 0], 180.0),
    ([0, 1, 0], 270.0),
    ([1, 0, 0], 90.0),
    ([1, 0, 0], -90.0),
]
"""Turns that take the wall at z = -1, facing +z, to the six walls of a room."""

OBLIQUE_AXIS = (1.0, 2.0, 3.0)
OBLIQUE_DEGREES = 33.0
"""The turn after which nothing is aligned with the voxels any more."""


def grey(value: float) -> SceneDict:
    return {"type": "rgb", "value": value}


def color(r: float, g: float, b: float) -> SceneDict:
    return {"type": "rgb", "value": [r, g, b]}


def diffuse(value: float = 0.5) -> SceneDict:
    return {"type": "diffuse", "reflectance": grey(value)}


def area_light(value: float = 1.0) -> SceneDict:
    return {"type": "area", "radiance": grey(value)}


def turned(axis: tuple[float, float, float], degrees: float) -> mi.ScalarAffineTransform4f:
    """Return a rotation; Mitsuba's own takes the axis as unit length without saying so."""
    unit = np.array(axis) / math.sqrt(float(np.dot(axis, axis)))
    turn: mi.ScalarAffineTransform4f = mi.ScalarTransform4f().rotate(unit.tolist(), degrees)
    return turn


def oblique() -> mi.ScalarAffineTransform4f:
    return turned(OBLIQUE_AXIS, OBLIQUE_DEGREES)


def rotation_matrix(transform: mi.ScalarAffineTransform4f) -> np.ndarray:
    rows: np.ndarray = np.array(transform.matrix, dtype=np.float64)[:3, :3]
    return rows


def room(to_world: mi.ScalarAffineTransform4f | None = None, **more: Any) -> SceneDict:
    """Six walls that face inwards, the inner faces of the cube from -1 to 1."""
    outer = to_world or mi.ScalarTransform4f()
    more.setdefault("bsdf", diffuse())
    walls: SceneDict = {}
    for index, (axis, degrees) in enumerate(INWARD_TURNS):
        turn = mi.ScalarTransform4f().rotate(axis, degrees).translate([0, 0, -1])
        walls[f"wall{index}"] = {"type": "rectangle", "to_world": outer @ turn, **more}
    return walls


def camera(
    origin: list[float],
    target: list[float],
    size: int = 16,
    fov: float = 60.0,
    outer: mi.ScalarAffineTransform4f | None = None,
) -> SceneDict:
    placed = mi.ScalarTransform4f().look_at(origin, target, [0, 1, 0])
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": (outer or mi.ScalarTransform4f()) @ placed,
        "film": {
            "type": "hdrfilm",
            "width": size,
            "height": size,
            "rfilter": {"type": "box"},
            "component_format": "float32",
        },
    }


def load(**parts: Any) -> mi.Scene:
    """Load a scene of these parts."""
    scene: mi.Scene = mi.load_dict({"type": "scene", **parts})
    return scene
