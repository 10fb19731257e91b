"""The room that most cases bend: six grey walls, a lamp below the ceiling, a camera in a corner."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np

import vctgi
from experiments.studies.check import StudyContext
from experiments.studies.light.lit_rooms import INWARD_TURNS
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.clipmap.storage import StorageConfig

Parts = dict[str, Any]

RESOLUTION, ROOM_EDGE, WINDOW_EDGE = 32, 2.0, 2.6
ALBEDO, RADIANCE = 0.6, 5.0
EDGE = 16
"""Pixels along an edge of the pictures."""

SETTINGS = "6 cones, 32^3 voxels in one level of 2.6 for a room of 2, one ray a pixel"

EYE, TARGET = (0.5, 0.2, 0.9), (0.0, -0.2, 0.0)


def grey(value: float) -> Parts:
    """Return a spectrum of one value."""
    return {"type": "rgb", "value": value}


def diffuse(albedo: float = ALBEDO) -> Parts:
    """Return a diffuse BSDF."""
    return {"type": "diffuse", "reflectance": grey(albedo)}


def settings(scale: float = 1.0, centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    """Return the configuration for a room of that scale around that point.

    All rooms of one scale share a layout and so their kernels, of which it is part.
    """
    config = vctgi.preset("medium")
    clipmap = ClipmapConfig(
        resolution=RESOLUTION,
        finest_voxel_size=scale * WINDOW_EDGE / RESOLUTION,
        level_count=1,
        centre=centre,
    )
    return replace(
        config,
        clipmap=clipmap,
        storage=StorageConfig(),
        samples_per_pixel=1,
        reconstruction=replace(config.reconstruction, sparsity=1),
    )


def camera(outer: Any = None, width: int = EDGE, height: int = EDGE) -> Parts:
    """Return the camera in its corner of the room that `outer` moved, scaled or mirrored."""
    matrix = np.array(_placed(outer).matrix, dtype=np.float64).reshape(4, 4)
    # A camera may not be scaled itself, so it is placed anew.
    eye, target = (matrix[:3, :3] @ each + matrix[:3, 3] for each in (EYE, TARGET))
    up = matrix[:3, :3] @ (0.0, 1.0, 0.0)
    up /= np.linalg.norm(up)
    place = mi.ScalarTransform4f().look_at(eye.tolist(), target.tolist(), up.tolist())
    film = {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "box"},
        "component_format": "float32",
    }
    # Mitsuba's rays begin at a plane before the eye, its own default of which reaches into walls.
    sensor: Parts = {"type": "perspective", "fov": 80.0, "near_clip": 1e-6}
    return {**sensor, "to_world": place, "film": film}


def walls(outer: Any = None, **more: Any) -> Parts:
    """Return six walls that face inwards, of the cube from -1 to 1."""
    found = {}
    for index, (axis, degrees) in enumerate(INWARD_TURNS):
        turn = mi.ScalarTransform4f().rotate(axis, degrees).translate([0, 0, -1])
        wall = {"type": "rectangle", "to_world": _placed(outer) @ turn}
        found[f"wall{index}"] = {**wall, "bsdf": diffuse(), **more}
    return found


FLOOR = "wall5"
"""Of the six walls the one at y = -1."""


def lamp(radiance: float = RADIANCE, outer: Any = None, height: float = 0.9) -> Parts:
    """Return a square lamp that shines down."""
    place = mi.ScalarTransform4f().translate([0, height, 0]).rotate([1, 0, 0], 90).scale(0.3)
    emitter = {"type": "area", "radiance": grey(radiance)}
    return {"type": "rectangle", "to_world": _placed(outer) @ place, "emitter": emitter}


def bulb(intensity: float, position: tuple[float, float, float] = (0.2, 0.1, -0.3)) -> Parts:
    """Return a light in a point."""
    return {"type": "point", "position": list(position), "intensity": grey(intensity)}


def room(outer: Any = None, **more: Any) -> Parts:
    """Return the whole scene; parts of the same name are replaced, those that are None left out."""
    parts = {"sensor": camera(outer), "lamp": lamp(outer=outer), **walls(outer), **more}
    return {name: part for name, part in parts.items() if part is not None}


def _placed(outer: Any) -> Any:
    return mi.ScalarTransform4f() if outer is None else outer


def render(parts: Parts, config: Any = None, seed: int = 0) -> np.ndarray:
    """Return indirect light [row, column, 6]: the diffuse and the specular part of it."""
    scene: mi.Scene = mi.load_dict({"type": "scene", **parts})
    chosen = config or settings()
    prepared = vctgi.prepare_scene(scene, scene.sensors()[0], chosen)
    volume = vctgi.light_volume(prepared, chosen).volume
    frame = vctgi.render_frame(prepared, volume, chosen, seed=seed)
    parts_of_light = [np.array(frame.indirect_diffuse), np.array(frame.indirect_specular)]
    return np.concatenate(parts_of_light, axis=-1)


def standard(context: StudyContext) -> np.ndarray:
    """Return the picture of the room as it is, which cases compare with."""
    return context.once("stability, the room", lambda: render(room()))


def mesh(name: str, vertices: np.ndarray, faces: np.ndarray, bsdf: Parts | None = None) -> mi.Mesh:
    """Return triangles as a Mitsuba mesh."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf or diffuse())
    made = mi.Mesh(name, len(vertices), len(faces), props=properties)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mi.Float(np.float32(vertices).ravel())
    parameters["faces"] = mi.UInt32(np.uint32(faces).ravel())
    parameters.update()
    return made
