"""Built-in scene: a glossy floor under a striped wall."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from experiments.scenes.parts import (
    SceneDict,
    ceiling_light,
    diffuse,
    empty_scene,
    perspective,
    room,
    solid_box,
)

_WIDTH, _HEIGHT, _LENGTH = 6.0, 3.2, 8.0
_STRIPE_COUNT = 12
_BRIGHT = (0.8, 0.75, 0.6)
_DARK = (0.06, 0.08, 0.14)


def glossy_floor(*, alpha: float = 0.1) -> SceneDict:
    """Show specular banding and the width of the lobe: a glossy floor under a striped wall.

    The march along the reflected cone has a fixed phase to the floor, so that a step that is too
    long shows as bands in the mirrored stripes. A closed room, lit by one area light.

    Parameters
    ----------
    alpha
        GGX width of the floor, (0, 1].

    Raises
    ------
    ValueError
        When alpha is outside its range.
    """
    if not 0.0 < alpha <= 1.0:
        raise ValueError(f"glossy_floor.alpha must be in (0, 1], got {alpha}: it is the GGX width.")
    floor: SceneDict = {
        "type": "roughconductor",
        "material": "none",
        "distribution": "ggx",
        "alpha": alpha,
        "specular_reflectance": {"type": "rgb", "value": [0.75, 0.75, 0.75]},
    }
    half = _WIDTH / 2
    scene = empty_scene()
    scene.update(
        room(
            (-half, 0.0, -_LENGTH),
            (half, _HEIGHT, 0.0),
            0.3,
            {"default": diffuse(0.55, 0.55, 0.55), "floor": floor, "back": _stripes()},
        )
    )
    scene["block"] = solid_box((0.9, -0.01, -5.0), (1.7, 1.1, -4.2), diffuse(0.65, 0.15, 0.1))
    scene["ball"] = {
        "type": "sphere",
        "center": [-1.3, 0.5, -4.6],
        "radius": 0.5,
        "bsdf": diffuse(0.15, 0.5, 0.2),
    }
    scene["light"] = ceiling_light((0.0, _HEIGHT - 0.01, -5.0), (2.0, 1.0), (14.0, 13.4, 12.3))
    scene["sensor"] = perspective((0.0, 1.3, -0.4), (0.0, 0.85, -_LENGTH), 55.0)
    return scene


def _stripes() -> SceneDict:
    """Diffuse surface with upright stripes: one texel a stripe, read without interpolation.

    The V coordinate of the back slab's face runs along X.
    """
    texels = np.array([[_BRIGHT], [_DARK]] * (_STRIPE_COUNT // 2), dtype=np.float32)
    return {
        "type": "diffuse",
        "reflectance": {
            "type": "bitmap",
            "bitmap": mi.Bitmap(texels),
            "filter_type": "nearest",
            "wrap_mode": "clamp",
        },
    }
