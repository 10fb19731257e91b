"""Lights of known power, and the reflective shadow maps that they get."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np

from tests.vctgi.small_scenes import SceneDict, area_light, diffuse, grey
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.scene.lights import list_lights
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.reflective_shadow_map import (
    ReflectiveShadowMapConfig,
    render_reflective_shadow_maps,
)

TEXELS_PER_VOXEL = 8.0
"""Maps of 512 texels along an edge."""

FIXED_POINT = 1e-5
"""Relative. Single-precision texel values; the sums of injection are exact to 2^-60."""


def layout() -> ClipmapLayout:
    return lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.06, level_count=1, resolution=64)


def shadow_maps(scene: mi.Scene) -> list[ReflectiveShadowMap]:
    return render_reflective_shadow_maps(
        scene,
        list_lights(scene),
        layout(),
        ReflectiveShadowMapConfig(texels_per_voxel=TEXELS_PER_VOXEL),
    )


def total(flux: mi.Color3f) -> np.ndarray:
    """Sum [channel] in double precision."""
    sums: np.ndarray = np.array(flux, dtype=np.float64).sum(axis=1)
    return sums


def spot_power(intensity: float, cutoff: float, beam: float) -> float:
    """Power of Mitsuba's spot: constant within the beam, linear in the angle to the cutoff."""
    outer, inner = math.radians(cutoff), math.radians(beam)
    angle = (np.arange(100_000) + 0.5) * outer / 100_000
    falloff = np.where(angle <= inner, 1.0, (outer - angle) / (outer - inner))
    return float(intensity * 2.0 * math.pi * np.mean(falloff * np.sin(angle)) * outer)


def lamp(shape: SceneDict) -> SceneDict:
    return {**shape, "emitter": area_light(2.0)}


def finite_lights() -> dict[str, tuple[SceneDict, float]]:
    """Lamps inside a room, with their power in W."""
    place = mi.ScalarTransform4f
    down = place().translate([0.0, 0.9, 0.0]).rotate([1, 0, 0], 90)
    small = place().rotate([0, 1, 0], 20).scale(0.2)
    aimed = place().look_at([0.1, 0.5, 0.0], [0.3, -1.0, 0.1], [0, 0, 1])
    lambert = 2.0 * math.pi
    ball_mesh = 6.0 * 0.4**2
    return {
        "point": (
            {"type": "point", "position": [0.2, 0.1, -0.3], "intensity": grey(3.0)},
            3.0 * 4.0 * math.pi,
        ),
        "spot": (
            {
                "type": "spot",
                "to_world": aimed,
                "intensity": grey(3.0),
                "cutoff_angle": 25.0,
                "beam_width": 15.0,
            },
            spot_power(3.0, 25.0, 15.0),
        ),
        "rectangle": (
            lamp({"type": "rectangle", "to_world": down.scale([0.3, 0.2, 1.0])}),
            lambert * 0.24,
        ),
        "disk": (lamp({"type": "disk", "to_world": down.scale(0.3)}), lambert * math.pi * 0.09),
        "sphere": (
            lamp({"type": "sphere", "center": [0.1, 0.2, 0.0], "radius": 0.25}),
            lambert * 4.0 * math.pi * 0.25**2,
        ),
        "cylinder": (
            lamp({"type": "cylinder", "p0": [0, -0.3, 0], "p1": [0, 0.3, 0], "radius": 0.2}),
            lambert * 2.0 * math.pi * 0.2 * 0.6,
        ),
        "mesh": (lamp({"type": "cube", "to_world": small}), lambert * ball_mesh),
        "directional area": (
            {
                "type": "rectangle",
                "to_world": down.scale([0.3, 0.2, 1.0]),
                "emitter": {"type": "directionalarea", "radiance": grey(2.0)},
            },
            2.0 * 0.24,
        ),
    }


def ball() -> SceneDict:
    # Off the middle of the map's texels, so that its outline does not run along them.
    return {"type": "sphere", "center": [0.1, -0.2, 0.05], "radius": 0.6, "bsdf": diffuse(0.5)}


LIGHT_NAMES = [
    "point",
    "spot",
    "rectangle",
    "disk",
    "sphere",
    "cylinder",
    "mesh",
    "directional area",
]
