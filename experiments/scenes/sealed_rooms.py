"""Built-in scene: a lit room beside a sealed dark one."""

from __future__ import annotations

import math

import mitsuba as mi

from experiments.scenes.parts import (
    SceneDict,
    ceiling_light,
    diffuse,
    empty_scene,
    perspective,
    room,
    solid_box,
)

_HALF_WIDTH = 2.4
_HEIGHT = 3.6
_DEPTH = 4.0
_OUTER_THICKNESS = 0.3
_OVERLAP = 0.15
"""How far the partition reaches into floor, ceiling, back and front."""
_EYE_DISTANCE = 6.0
"""From the eye to the inner side of the front wall."""
_NEAR_GAP = 0.05
"""From the inner side of the front wall to the near plane."""
_LID_GAP = 0.01
"""From the near plane to the lid on the cut."""
_LID_SHARE = 0.999
"""Width of the lid over that of the partition, so that no light can touch it."""
_FOV_DEG = 31.0
_EYE_X = 0.3
"""To the dark side, so that the partition's dark face is seen."""
_THICKEST = 2.0


def sealed_rooms(*, wall_thickness: float = 0.2, turn: float = 0.0) -> SceneDict:
    """Show light leaking: a lit room beside a sealed dark one.

    Every wall is a closed solid and the rooms share only the partition, so the true radiance in the
    dark room (the right part of the picture) is exactly zero. The camera stands outside; its near
    plane lies just behind the front wall, which cuts the wall from view and not from the light.
    The black strip between the rooms is the cut through the partition.

    Parameters
    ----------
    wall_thickness
        Thickness of the partition, (0, 2) metres.
    turn
        Angle in radians by which building and camera are turned together about Y, to put the walls
        askew to the voxels; the picture does not change.

    Raises
    ------
    ValueError
        When the partition would fill the rooms.
    """
    if not 0.0 < wall_thickness < _THICKEST:
        raise ValueError(
            f"sealed_rooms.wall_thickness must be in (0, {_THICKEST}), got {wall_thickness}: "
            "a thicker partition fills the rooms."
        )
    turned = mi.ScalarTransform4f().rotate([0, 1, 0], math.degrees(turn))
    white = diffuse(0.7, 0.7, 0.7)
    scene = empty_scene()
    scene.update(
        room(
            (-_HALF_WIDTH, 0.0, -_DEPTH),
            (_HALF_WIDTH, _HEIGHT, 0.0),
            _OUTER_THICKNESS,
            {"default": white, "west": diffuse(0.6, 0.25, 0.1)},
            world_from_model=turned,
        )
    )
    half = wall_thickness / 2
    scene["partition"] = solid_box(
        (-half, -_OVERLAP, -_DEPTH - _OVERLAP),
        (half, _HEIGHT + _OVERLAP, _OVERLAP),
        white,
        world_from_model=turned,
    )
    # The camera looks into the cut wall; a black lid keeps its hollow inside out of the picture.
    scene["cut"] = {
        "type": "rectangle",
        "to_world": turned
        @ mi.ScalarTransform4f()
        .translate([0.0, _HEIGHT / 2, -_NEAR_GAP - _LID_GAP])
        .scale([half * _LID_SHARE, _HEIGHT / 2, 1.0]),
        "bsdf": diffuse(0.0, 0.0, 0.0),
    }
    blue = diffuse(0.15, 0.3, 0.6)
    for name, x in (("block_lit", -1.1), ("block_dark", 1.5)):
        scene[name] = solid_box(
            (x - 0.4, -0.01, -2.9), (x + 0.4, 0.9, -2.1), blue, world_from_model=turned
        )
    scene["light"] = ceiling_light(
        (-1.0, _HEIGHT - 0.01, -_DEPTH / 2), (0.8, 1.2), (9.0, 8.4, 7.0), world_from_model=turned
    )
    middle = _HEIGHT / 2
    scene["sensor"] = perspective(
        (_EYE_X, middle, _EYE_DISTANCE),
        (_EYE_X, middle, 0.0),
        _FOV_DEG,
        near_clip=_EYE_DISTANCE + _NEAR_GAP,
        world_from_model=turned,
    )
    return scene
