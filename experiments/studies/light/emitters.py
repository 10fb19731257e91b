"""One emitter of each kind, in scenes where the power that they bring is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.scene.lights import list_lights
from vctgi.stages.reflective_shadow_map import (
    ReflectiveShadowMapConfig,
    render_reflective_shadow_maps,
)

SceneDict = dict[str, Any]

BALL_RADIUS = 0.6

DIRECT_POINTS = 1 << 20
"""Points of a surface whose direct light is summed where there is no closed form."""


@dataclass(frozen=True, kw_only=True)
class LitScene:
    """An emitter with the surfaces that its light reaches.

    Attributes
    ----------
    parts
        Scene in Mitsuba's terms.
    power
        What reaches a surface, W, in closed form; None where Mitsuba's direct light must tell.
    """

    parts: SceneDict
    power: float | None

    def load(self) -> mi.Scene:
        """Load the scene."""
        scene: mi.Scene = mi.load_dict({"type": "scene", **self.parts})
        return scene


def window() -> ClipmapLayout:
    """Return one level of 64^3 voxels around a room two wide."""
    return lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.06, level_count=1, resolution=64)


def map_power(scene: mi.Scene) -> float:
    """Power of the green channel that the maps of a scene hold, W."""
    maps = render_reflective_shadow_maps(
        scene, list_lights(scene), window(), ReflectiveShadowMapConfig()
    )
    return sum(float(np.array(each.incident_flux, dtype=np.float64)[1].sum()) for each in maps)


def direct_power(scene: mi.Scene) -> float:
    """Power of the green channel by points that look for the light, W."""
    power = 0.0
    for shape in scene.shapes():
        if shape.is_emitter():
            continue
        sampler: Any = mi.load_dict({"type": "independent"})
        sampler.seed(3, DIRECT_POINTS)
        sample = shape.sample_position(0.0, sampler.next_2d())
        si = dr.zeros(mi.SurfaceInteraction3f, DIRECT_POINTS)
        si.p, si.n, si.sh_frame = sample.p, sample.n, mi.Frame3f(sample.n)
        light, value = scene.sample_emitter_direction(si, sampler.next_2d())
        cosine = dr.maximum(dr.dot(sample.n, light.d), 0.0)
        area = float(np.array(shape.surface_area()).ravel()[0])
        power += float(np.array(mi.Float(value.y * cosine), dtype=np.float64).mean()) * area
    return power


def lit_scenes() -> dict[str, LitScene]:
    """Return an emitter of each kind by name."""
    found = {
        name: LitScene(parts={"light": light, **room_walls()}, power=power)
        for name, (light, power) in _lamps().items()
    }
    ball = {"type": "sphere", "center": [0.1, -0.2, 0.05], "radius": BALL_RADIUS}
    for name, (light, power) in _distant().items():
        found[name] = LitScene(parts={"light": light, "ball": ball}, power=power)
    return found


def room_walls() -> SceneDict:
    """Return six walls that face inwards, of a room two wide."""
    turns = [([0, 1, 0], 90.0 * quarter) for quarter in range(4)]
    turns += [([1, 0, 0], 90.0), ([1, 0, 0], -90.0)]
    place = mi.ScalarTransform4f
    return {
        f"wall{number}": {
            "type": "rectangle",
            "to_world": place().rotate(axis, degrees).translate([0, 0, -1]),
        }
        for number, (axis, degrees) in enumerate(turns)
    }


def _grey(value: float) -> SceneDict:
    return {"type": "rgb", "value": value}


def _picture(values: np.ndarray) -> SceneDict:
    held = mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32))
    return {"type": "bitmap", "bitmap": held, "raw": True, "filter_type": "nearest"}


def _spot_power(intensity: float, cutoff: float, beam: float) -> float:
    """Power of Mitsuba's spot: constant within the beam, linear in the angle to the cutoff."""
    a, b = math.radians(beam), math.radians(cutoff)
    inner = 1.0 - math.cos(a)
    # Integral of (b - x) sin x / (b - a) from a to b.
    outer = math.cos(a) - (math.sin(b) - math.sin(a)) / (b - a)
    return 2.0 * math.pi * intensity * (inner + outer)


def _lamps() -> dict[str, tuple[SceneDict, float | None]]:
    """Lamps for a closed room, with their power where it has a closed form."""
    place = mi.ScalarTransform4f
    down = place().translate([0.0, 0.9, 0.0]).rotate([1, 0, 0], 90)
    aimed = place().look_at([0.1, 0.5, 0.0], [0.3, -1.0, 0.1], [0, 0, 1])
    area = {"type": "area", "radiance": _grey(2.0)}
    lambert = 2.0 * math.pi
    pixels = np.zeros((4, 4, 3))
    pixels[1, 2], pixels[3, 0] = 8.0, 24.0
    slide = np.linspace(0.2, 2.0, 8)[None, :, None] * np.ones((8, 8, 3))
    spot = {"type": "spot", "to_world": aimed, "cutoff_angle": 25.0, "beam_width": 15.0}
    return {
        "point": (
            {"type": "point", "position": [0.2, 0.1, -0.3], "intensity": _grey(3.0)},
            12.0 * math.pi,
        ),
        "spot": ({**spot, "intensity": _grey(3.0)}, _spot_power(3.0, 25.0, 15.0)),
        "spot, textured": ({**spot, "texture": _picture(slide)}, None),
        "area, rectangle": (
            {"type": "rectangle", "to_world": down.scale([0.3, 0.2, 1.0]), "emitter": area},
            0.24 * lambert,
        ),
        "area, disk": (
            {"type": "disk", "to_world": down.scale(0.3), "emitter": area},
            0.09 * math.pi * lambert,
        ),
        "area, sphere": (
            {"type": "sphere", "center": [0.1, 0.2, 0.0], "radius": 0.25, "emitter": area},
            0.25 * math.pi * lambert,
        ),
        "area, cylinder": (
            {"type": "cylinder", "p0": [0, -0.3, 0], "p1": [0, 0.3, 0], "radius": 0.2}
            | {"emitter": area},
            0.24 * math.pi * lambert,
        ),
        "area, mesh": (
            {"type": "cube", "to_world": place().rotate([0, 1, 0], 20).scale(0.2)}
            | {"emitter": area},
            0.96 * lambert,
        ),
        "area, textured": (
            {"type": "rectangle", "to_world": down.scale(0.3)}
            | {"emitter": {"type": "area", "radiance": _picture(pixels)}},
            math.pi * 0.36 * float(pixels[..., 1].mean()),
        ),
        "directional area": (
            {"type": "rectangle", "to_world": down.scale([0.3, 0.2, 1.0])}
            | {"emitter": {"type": "directionalarea", "radiance": _grey(2.0)}},
            0.48,
        ),
        "projector": (
            {"type": "projector", "to_world": aimed, "fov": 50.0, "irradiance": _picture(slide)},
            None,
        ),
    }


def _distant() -> dict[str, tuple[SceneDict, float | None]]:
    """Light from outside on a ball, with what the ball receives where it has a closed form."""
    section = math.pi * BALL_RADIUS**2
    sky = np.full((16, 32, 3), 0.5)
    sky[5, 7] = 60.0
    held = [mi.Bitmap(each.astype(np.float32)) for each in (np.full((16, 32, 3), 2.0), sky)]
    return {
        # A convex body of area A collects pi L A; a beam of irradiance E its shadow times E.
        "constant": ({"type": "constant", "radiance": _grey(2.0)}, 8.0 * math.pi * section),
        "directional": (
            {"type": "directional", "direction": [1, -2, 0.5], "irradiance": _grey(2.0)},
            2.0 * section,
        ),
        "envmap, even": ({"type": "envmap", "bitmap": held[0]}, 8.0 * math.pi * section),
        "envmap, uneven": ({"type": "envmap", "bitmap": held[1]}, None),
        "sunsky": ({"type": "sunsky", "sun_direction": [0.4, 0.3, 0.8], "turbidity": 4.0}, None),
    }
