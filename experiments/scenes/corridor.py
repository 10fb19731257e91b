"""Built-in scene: a corridor of rooms some hundred metres long."""

from __future__ import annotations

from experiments.scenes.parts import (
    SceneDict,
    Vector,
    ceiling_light,
    diffuse,
    empty_scene,
    perspective,
    room,
    solid_box,
)

_ROOM_COUNT = 10
_ROOM_LENGTH = 10.0
_HALF_WIDTH = 3.0
_HEIGHT = 3.6
_WALL = 0.3
_OVERLAP = 0.15
_DOOR_HEIGHT = 2.7
_DOOR_HALF_WIDTH = 1.1
_LIT_ROOMS = (0, 2, 3, 5, 6, 8, 9)
_WALL_COLOURS: tuple[Vector, ...] = (
    (0.65, 0.2, 0.15),
    (0.2, 0.55, 0.25),
    (0.2, 0.35, 0.65),
    (0.65, 0.55, 0.2),
    (0.5, 0.25, 0.55),
)


def corridor() -> SceneDict:
    """Show the outer levels of the clipmap: ten rooms in a row, a hundred metres in all.

    The camera looks along the row through the doors; three rooms have no light of their own and
    live on what comes through, so that light and walls far from the eye matter.
    """
    length = _ROOM_COUNT * _ROOM_LENGTH
    white = diffuse(0.7, 0.7, 0.7)
    scene = empty_scene()
    scene.update(
        room((-_HALF_WIDTH, 0.0, -length), (_HALF_WIDTH, _HEIGHT, 0.0), _WALL, {"default": white})
    )
    for index in range(_ROOM_COUNT):
        near = -index * _ROOM_LENGTH
        if index > 0:
            _add_partition(scene, index, near, white)
        _add_furniture(scene, index, near)
        if index in _LIT_ROOMS:
            scene[f"light_{index}"] = ceiling_light(
                (0.0, _HEIGHT - 0.01, near - 0.55 * _ROOM_LENGTH), (1.6, 2.4), (6.5, 6.2, 5.6)
            )
    scene["sensor"] = perspective((0.5, 1.7, -0.5), (-0.1, 1.45, -length), 60.0)
    return scene


def _add_partition(scene: SceneDict, index: int, z: float, bsdf: SceneDict) -> None:
    """Wall with a door; the doors swerve a little, so that not every room sees every other."""
    door = 0.3 if index % 2 else -0.3
    west, east = door - _DOOR_HALF_WIDTH, door + _DOOR_HALF_WIDTH
    z0, z1 = z - _WALL / 2, z + _WALL / 2
    top = _HEIGHT + _OVERLAP
    side = _HALF_WIDTH + _OVERLAP
    scene[f"partition_{index}_west"] = solid_box((-side, -_OVERLAP, z0), (west, top, z1), bsdf)
    scene[f"partition_{index}_east"] = solid_box((east, -_OVERLAP, z0), (side, top, z1), bsdf)
    scene[f"partition_{index}_lintel"] = solid_box(
        (west - _OVERLAP, _DOOR_HEIGHT, z0 + 0.01), (east + _OVERLAP, top, z1 - 0.01), bsdf
    )


def _add_furniture(scene: SceneDict, index: int, near: float) -> None:
    """Coloured panels on both walls and a block, in the colours of this room."""
    left = diffuse(*_WALL_COLOURS[index % len(_WALL_COLOURS)])
    right = diffuse(*_WALL_COLOURS[(index + 2) % len(_WALL_COLOURS)])
    z0, z1 = near - 0.85 * _ROOM_LENGTH, near - 0.15 * _ROOM_LENGTH
    inner, outer = _HALF_WIDTH - 0.1, _HALF_WIDTH + _OVERLAP
    scene[f"panel_{index}_west"] = solid_box((-outer, 0.3, z0), (-inner, 3.2, z1), left)
    scene[f"panel_{index}_east"] = solid_box((inner, 0.3, z0), (outer, 3.2, z1), right)
    x = -2.0 if index % 2 else 1.5
    scene[f"block_{index}"] = solid_box(
        (x, -0.05, near - 7.4), (x + 0.8, 0.9, near - 6.6), diffuse(0.5, 0.48, 0.45)
    )
