"""A bare mesh as a scene: a default light and a camera that frames it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import mitsuba as mi
import numpy as np

from experiments.errors import InputError
from experiments.scenes.gltf import load_gltf
from experiments.scenes.parts import SceneDict, empty_scene, perspective

_FOV_DEG: Final = 40.0
_VIEW_DIRECTION: Final = (0.55, 0.4, 1.0)
"""From the middle of the mesh to the eye, before normalization."""
_SUN_DIRECTION: Final = (-0.4, -1.0, -0.6)
DEFAULT_LIGHT_WARNING: Final = "the file has no light: a default sky and sun were added"


def mesh_scene(path: Path) -> tuple[SceneDict, list[str]]:
    """Scene dict around a glTF, OBJ or PLY file, and what was left out of it.

    The camera looks at the middle of the bounding box from a distance at which the sphere around
    the box fits the picture. A file that has no light gets a sky of radiance 0.4 W m^-2 sr^-1
    and a sun of irradiance 2 W m^-2.

    Raises
    ------
    InputError
        When the file has no triangles, or its glTF is broken.
    RuntimeError
        From Mitsuba, when it cannot read the OBJ or PLY file.
    """
    scene = empty_scene()
    has_light = False
    if path.suffix.lower() in (".gltf", ".glb"):
        converted = load_gltf(path)
        objects, warnings, has_light = converted.objects, converted.warnings, converted.has_light
    else:
        objects, warnings = _plain_mesh(path)
    if not objects:
        raise InputError(
            what="the file has no geometry (no triangles)",
            where=str(path),
            remedy="export it with its meshes",
        )
    scene.update(objects)
    if not has_light:
        scene.update(_default_light())
        warnings = [*warnings, DEFAULT_LIGHT_WARNING]
    scene["sensor"] = _framing_camera(list(objects.values()))
    return scene, warnings


def _plain_mesh(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Load the mesh of an OBJ or PLY file under a grey two-sided surface."""
    kind = path.suffix.lower().removeprefix(".")
    grey = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.6, 0.6]}}
    mesh = mi.load_dict(
        {
            "type": kind,
            "id": "mesh",
            "filename": str(path),
            "bsdf": {"type": "twosided", "nested": grey},
        }
    )
    warnings = []
    if kind == "obj" and b"\nmtllib" in b"\n" + path.read_bytes():
        warnings.append("OBJ materials ignored: all surfaces are grey")
    return {"mesh": mesh}, warnings


def _default_light() -> SceneDict:
    return {
        "default_sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.4] * 3}},
        "default_sun": {
            "type": "directional",
            "direction": list(_SUN_DIRECTION),
            "irradiance": {"type": "rgb", "value": [2.0] * 3},
        },
    }


def _framing_camera(meshes: list[Any]) -> SceneDict:
    boxes = [mesh.bbox() for mesh in meshes]
    low = np.min([np.array(box.min) for box in boxes], axis=0)
    high = np.max([np.array(box.max) for box in boxes], axis=0)
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    if not (np.isfinite(radius) and radius > 0):
        # Any camera will do: the checks refuse this geometry and name it.
        centre, radius = np.zeros(3), 1.0
    distance = radius / math.sin(math.radians(_FOV_DEG / 2))
    direction = np.array(_VIEW_DIRECTION) / np.linalg.norm(_VIEW_DIRECTION)
    x, y, z = (float(value) for value in centre)
    ex, ey, ez = (float(value) for value in centre + distance * direction)
    return perspective(
        (ex, ey, ez),
        (x, y, z),
        _FOV_DEG,
        near_clip=distance * 1e-3,
        far_clip=distance * 10,
    )
