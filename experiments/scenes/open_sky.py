"""Built-in scene: objects on open ground under a sky and a sun."""

from __future__ import annotations

import mitsuba as mi

from experiments.scenes.parts import (
    SceneDict,
    area_light,
    diffuse,
    empty_scene,
    perspective,
    solid_box,
)

_GROUND_HALF_EDGE = 30.0


def open_sky() -> SceneDict:
    """Show light from cones that leave the clipmap: an open scene under a sky and a sun.

    Boxes and balls on wide ground, one of them glowing and one of them glossy; the shaded sides
    see the sky, the ground and one another.
    """
    scene = empty_scene()
    edge = _GROUND_HALF_EDGE
    scene["ground"] = solid_box((-edge, -1.0, -edge), (edge, 0.0, edge), diffuse(0.4, 0.36, 0.3))
    scene["tower"] = solid_box((-3.4, -0.1, -4.6), (-1.8, 4.2, -3.0), diffuse(0.65, 0.2, 0.12))
    scene["wall"] = solid_box((-1.0, -0.1, -5.4), (3.6, 2.0, -5.0), diffuse(0.7, 0.7, 0.68))
    scene["block"] = solid_box((1.5, -0.1, -2.2), (2.7, 1.0, -1.0), diffuse(0.15, 0.4, 0.6))
    scene["ball"] = {
        "type": "sphere",
        "center": [0.0, 0.8, -2.4],
        "radius": 0.8,
        "bsdf": diffuse(0.75, 0.6, 0.15),
    }
    scene["glossy_ball"] = {
        "type": "sphere",
        "center": [-1.4, 0.5, -0.9],
        "radius": 0.5,
        "bsdf": {
            "type": "roughconductor",
            "material": "none",
            "distribution": "ggx",
            "alpha": 0.2,
            "specular_reflectance": {"type": "rgb", "value": [0.8, 0.78, 0.72]},
        },
    }
    scene["lamp"] = solid_box((0.5, -0.1, -0.9), (0.9, 0.4, -0.5), diffuse(0.0, 0.0, 0.0))
    scene["lamp"]["emitter"] = area_light(2.4, 1.2, 0.4)
    scene["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [0.22, 0.3, 0.42]}}
    scene["sun"] = {
        "type": "directional",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=[5.0, 7.0, 3.0], target=[0.0, 0.0, 0.0], up=[0, 1, 0]
        ),
        "irradiance": {"type": "rgb", "value": [1.3, 1.2, 1.0]},
    }
    scene["sensor"] = perspective((1.2, 2.4, 6.5), (0.0, 1.0, -2.5), 45.0)
    return scene
