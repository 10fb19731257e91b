"""The scenes of the study: one that needs little, one that needs all, and what single cases add."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from experiments.scenes.parts import (
    SceneDict,
    Vector,
    area_light,
    diffuse,
    empty_scene,
    perspective,
    solid_box,
)

FAR = 12.0
"""Half edge of the ground that needs further levels, times the room that the camera sees."""


def court(size: int) -> SceneDict:
    """Return the scene that needs little: two walls and the ground, diffuse, under one lamp.

    It is held by one level, nothing faces -x, -y or -z, and nothing moves.
    """
    scene = _seen_from(size, (2.6, 1.6, 2.9), (0.0, 0.55, 0.0))
    scene["ground"] = _rectangle([1, 0, 0], -90, [0, 0, 0], diffuse(0.6, 0.55, 0.5))
    scene["back"] = _rectangle([1, 0, 0], 0, [0, 1, -1], diffuse(0.7, 0.25, 0.15))
    scene["side"] = _rectangle([0, 1, 0], 90, [-1, 1, 0], diffuse(0.2, 0.5, 0.3))
    scene["lamp"] = {
        "type": "point",
        "position": [0.4, 1.5, 0.5],
        "intensity": {"type": "rgb", "value": [3.0, 2.8, 2.5]},
    }
    return scene


def court_with_balls(size: int) -> SceneDict:
    """Return the court with three balls, thousands of triangles."""
    scene = court(size)
    for number, x in enumerate((-0.6, 0.0, 0.6)):
        scene[f"ball{number}"] = {
            "type": "sphere",
            "center": [x, 0.25, 0.2],
            "radius": 0.25,
            "bsdf": diffuse(0.6, 0.6, 0.6),
        }
    return scene


def court_with_screen(size: int) -> SceneDict:
    """Return the court with a masked screen whose mask is opaque all over."""
    scene = court(size)
    scene["side"]["bsdf"] = {
        "type": "mask",
        "opacity": {"type": "bitmap", "data": mi.TensorXf([1.0] * 16, (4, 4, 1)), "raw": True},
        "nested": diffuse(0.2, 0.5, 0.3),
    }
    return scene


def court_with_dead_lights(size: int) -> SceneDict:
    """Return the court with a dark lamp, a lamp that shines away, and a black sky."""
    scene = court(size)
    black = {"type": "rgb", "value": [0.0, 0.0, 0.0]}
    scene["off"] = {"type": "point", "position": [-0.4, 1.2, 0.2], "intensity": black}
    scene["away"] = _rectangle([1, 0, 0], -90, [0, 3, 0], diffuse(0.0, 0.0, 0.0))
    scene["away"]["emitter"] = area_light(2.0, 2.0, 2.0)
    return scene


def court_at_night(size: int) -> SceneDict:
    """Return the court under a sky without light."""
    scene = court(size)
    scene["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.0, 0.0, 0.0]}}
    return scene


def closed_box(size: int) -> SceneDict:
    """Return a closed room of albedo 0.3 with a lamp in it, whose light bounces for long."""
    scene = _seen_from(size, (0.0, 0.0, 0.9), (0.0, 0.0, 0.0), 80.0)
    turns: list[tuple[list[int], float]] = [([0, 1, 0], 90.0 * turn) for turn in range(4)]
    turns += [([1, 0, 0], 90.0), ([1, 0, 0], -90.0)]
    for number, (axis, degrees) in enumerate(turns):
        turn = mi.ScalarTransform4f().rotate(axis, degrees).translate([0, 0, -1])
        bsdf = diffuse(0.3, 0.3, 0.3)
        scene[f"wall{number}"] = {"type": "rectangle", "to_world": turn, "bsdf": bsdf}
    intensity = {"type": "rgb", "value": [1.0, 0.9, 0.8]}
    scene["lamp"] = {"type": "point", "position": [0.2, 0.3, 0.1], "intensity": intensity}
    return scene


def everything(size: int) -> SceneDict:
    """Return the scene that needs all: nothing of it can be left out but what nobody asked for.

    Glossy and mirror surfaces, a screen with holes, thin glass, a sky, a lamp, surfaces that face
    all ways at every level, as far as the coarsest window reaches.
    """
    scene = court_with_balls(size)
    scene["ground"] = solid_box((-FAR, -1.0, -FAR), (FAR, 0.0, FAR), diffuse(0.6, 0.55, 0.5))
    scene["post"] = solid_box((-FAR, 0.0, -FAR), (-0.7 * FAR, 10.0, 0.0), diffuse(0.5, 0.5, 0.5))
    scene["ball0"]["bsdf"] = {"type": "conductor"}
    scene["ball1"]["bsdf"] = {"type": "roughplastic", "alpha": 0.2}
    scene["ball2"]["bsdf"] = {"type": "roughconductor", "alpha": 0.25}
    holes = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.ones((4, 4)))[..., None]
    scene["screen"] = _rectangle([1, 0, 0], 0, [0, 1, -0.4], diffuse(0.5, 0.5, 0.5))
    scene["screen"]["bsdf"] = {
        "type": "mask",
        "opacity": {"type": "bitmap", "data": mi.TensorXf(holes.astype(np.float32)), "raw": True},
        "nested": {"type": "twosided", "bsdf": diffuse(0.5, 0.5, 0.5)},
    }
    scene["glass"] = _rectangle([0, 1, 0], 60, [0.9, 0.3, 0.0], {"type": "thindielectric"}, 0.3)
    scene["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.35, 0.4]}}
    return scene


def _rectangle(
    axis: list[int], degrees: float, centre: list[float], bsdf: SceneDict, scale: float = 1.0
) -> SceneDict:
    """Return a square of edge 2, which faces +z, scaled, turned and moved."""
    place: Any = mi.ScalarTransform4f().translate(centre).rotate(axis, degrees).scale(scale)
    return {"type": "rectangle", "to_world": place, "bsdf": bsdf}


def _seen_from(size: int, origin: Vector, target: Vector, fov: float = 40.0) -> SceneDict:
    scene = empty_scene()
    scene["sensor"] = perspective(origin, target, fov)
    scene["sensor"]["film"]["width"] = scene["sensor"]["film"]["height"] = size
    return scene
