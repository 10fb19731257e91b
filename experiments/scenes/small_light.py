"""Built-in scene: a small glowing object and a spot light, both movable."""

from __future__ import annotations

import mitsuba as mi

from experiments.scenes.parts import (
    SceneDict,
    Vector,
    add,
    area_light,
    diffuse,
    empty_scene,
    perspective,
    room,
    solid_box,
)

_NO_OFFSET: Vector = (0.0, 0.0, 0.0)
_OBJECT_HALF_EDGE = 0.04
_OBJECT_CENTRE: Vector = (-1.0, 1.0, -2.6)
_LIGHT_ORIGIN: Vector = (0.3, 2.4, -1.2)
_LIGHT_TARGET: Vector = (1.6, 0.9, -4.0)


def small_light(
    *, light_offset: Vector = _NO_OFFSET, object_offset: Vector = _NO_OFFSET
) -> SceneDict:
    """Show injection aliasing: a glowing cube smaller than a voxel and a spot light's sharp patch.

    The spot light lights a patch of wall and floor, and the rest of the room sees the patch. Moved
    by a part of a voxel, light or cube change the true picture smoothly; jumps are aliasing.

    Parameters
    ----------
    light_offset
        Shift of the spot light and of what it aims at, metres.
    object_offset
        Shift of the glowing cube (8 cm wide), metres.
    """
    scene = empty_scene()
    scene.update(
        room(
            (-2.0, 0.0, -4.0),
            (2.0, 2.6, 0.0),
            0.25,
            {"default": diffuse(0.65, 0.65, 0.65), "east": diffuse(0.2, 0.45, 0.65)},
        )
    )
    half: Vector = (_OBJECT_HALF_EDGE,) * 3
    centre = add(_OBJECT_CENTRE, object_offset)
    low: Vector = (centre[0] - half[0], centre[1] - half[1], centre[2] - half[2])
    scene["object"] = solid_box(low, add(centre, half), diffuse(0.0, 0.0, 0.0))
    scene["object"]["emitter"] = area_light(100.0, 60.0, 24.0)
    scene["pillar"] = solid_box((-0.25, -0.01, -3.2), (0.25, 1.2, -2.7), diffuse(0.6, 0.55, 0.5))
    scene["light"] = {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=add(_LIGHT_ORIGIN, light_offset),
            target=add(_LIGHT_TARGET, light_offset),
            up=[0, 1, 0],
        ),
        "intensity": {"type": "rgb", "value": [40.0, 38.5, 35.5]},
        "cutoff_angle": 16.0,
        "beam_width": 15.0,
    }
    scene["sensor"] = perspective((0.0, 1.35, -0.15), (0.0, 1.1, -4.0), 62.0)
    return scene
