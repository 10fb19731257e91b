"""Which parameters of a scene the picture's derivatives reach; the others are refused.

A derivative that is cut on its way is zero without a word, and an optimiser that uses it stands
still. So only parameters are let through whose whole way is differentiated.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from vctgi.errors import SceneError

SURFACE_NAMES = (
    "reflectance",
    "diffuse_reflectance",
    "specular_reflectance",
    "base_color",
    "alpha",
    "roughness",
)
"""Parameters of BSDFs, constant or textures, that have derivatives."""

LIGHT_NAMES = ("radiance", "intensity", "irradiance")
"""Parameters of emitters that have."""

VALUES = ("value", "data")
"""What constant and bitmap textures call their numbers."""


def has_derivatives(name: str) -> bool:
    """Whether the picture has derivatives by a parameter of `mi.traverse` of this name."""
    parts = name.split(".")
    return len(parts) >= 2 and parts[-1] in VALUES and parts[-2] in (*SURFACE_NAMES, *LIGHT_NAMES)


def check_derivatives(scene: mi.Scene, cut: tuple[str, ...] = ()) -> None:
    """Refuse derivatives that would be cut.

    Parameters
    ----------
    scene
        The scene.
    cut
        Names of `LIGHT_NAMES` whose way is not differentiated in this configuration.

    Raises
    ------
    SceneError
        A parameter has derivatives enabled that the picture has none by.
    """
    parameters: Any = mi.traverse(scene)
    for name in list(parameters.keys()):
        value = parameters[name]
        if dr.grad_enabled(value) and not (has_derivatives(name) and _is_whole(name, cut)):
            raise SceneError(
                "no derivative",
                f"the parameter '{name}'",
                "detach it: shapes, places and directions fill voxels in jumps; masks, light "
                "that voxels emit by themselves and a sky that cones see are not differentiated",
            )


def _is_whole(name: str, cut: tuple[str, ...]) -> bool:
    """Whether the parameter is none of those that are cut."""
    return name.split(".")[-2] not in cut
