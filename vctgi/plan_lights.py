"""Which emitters a frame needs a reflective shadow map of."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.plan_entries import PlanEntry, left_out_entry
from vctgi.scene.constants import is_dark
from vctgi.scene.emissive import list_emissive_surfaces
from vctgi.scene.lights import Light
from vctgi.scene.registry import registry_number
from vctgi.scene.triangles import SceneTriangles
from vctgi.stages.reflective_shadow_map import survey_distant, survey_lamps

LAMP_SURVEY_EDGES = (32, 128)
"""Rays along an edge of the map by which a lamp is judged; the second where none of the first
landed."""

IN_FRONT = 1e-7
"""Share of the scene's extent by which a point must lie before a lamp's plane to be lit by it."""


def choose_lights(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    triangles: SceneTriangles,
    config: RenderConfig,
) -> tuple[list[Light], list[PlanEntry]]:
    """Leave out lights that are dark and lamps that everything lies behind.

    Raises
    ------
    SceneError
        A power that is negative, infinite or NaN; a lamp that only shines on backs.
    """
    unreached = _survey(scene, lights, layout)
    if config.is_kept("lights"):
        return lights, []
    dark = [light for light in lights if is_dark(light.emitter)]
    behind = [
        light for light in unreached if light not in dark and _lies_behind(scene, light, triangles)
    ]
    left_out = {
        "lights without power": (dark, "their light is zero all over"),
        "lights that reach nothing": (behind, "everything lies behind them"),
    }
    entries = [
        left_out_entry(
            "lights",
            item=item,
            reason=f"{reason}: {', '.join(each.name for each in chosen)}",
            saved=f"{len(chosen)} reflective shadow maps",
        )
        for item, (chosen, reason) in left_out.items()
        if chosen
    ]
    gone = {id(light) for light in [*dark, *behind]}
    return [light for light in lights if id(light) not in gone], entries


def _survey(scene: mi.Scene, lights: list[Light], layout: ClipmapLayout) -> list[Light]:
    """Refuse lights that cannot be; return lamps of whose light no ray met a surface."""
    power = {id(light): survey_distant(light) for light in lights if light.is_infinite}
    lamps = [light for light in lights if not light.is_infinite]
    for edge in LAMP_SURVEY_EDGES:
        if not lamps:
            break
        found = survey_lamps(scene, lamps, layout, edge)
        power |= {id(light): float(each) for light, each in zip(lamps, found.power, strict=True)}
        for light, landed, met in zip(lamps, found.landed, found.met_front, strict=True):
            if power[id(light)] > 0.0 and landed > 0 and met == 0:
                raise SceneError(
                    "its light meets nothing but the backs of one-sided surfaces",
                    f"emitter '{light.name}'",
                    "it stands inside geometry: move it out, or make the surface two-sided",
                )
        lamps = [each for each, landed in zip(lamps, found.landed, strict=True) if landed == 0]
    for light in lights:
        if not 0.0 <= power[id(light)] < float("inf"):
            raise SceneError(
                "its power is negative, infinite or NaN",
                f"emitter '{light.name}'",
                "correct its radiance",
            )
    return lamps


def _lies_behind(scene: mi.Scene, light: Light, triangles: SceneTriangles) -> bool:
    """Whether no surface can be where a lamp shines; other kinds of lamps are never sure."""
    if light.kind == "AreaLight":
        return _lies_behind_area(scene, light, triangles)
    return light.kind == "SpotLight" and _lies_beside_spot(light, triangles)


def _lies_behind_area(scene: mi.Scene, light: Light, triangles: SceneTriangles) -> bool:
    """Whether every vertex lies behind the planes of all triangles of an area light."""
    emissive = list_emissive_surfaces(scene)
    number = registry_number(mi.EmitterPtr(light.emitter))
    own = emissive.surfaces.vertices[emissive.emitter_number == number]
    normal = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    low, high = triangles.bounds
    points = triangles.vertices.reshape(-1, 3)
    room = IN_FRONT * float(np.max(high - low))
    planes = zip(normal, own[:, 0], strict=True)
    return len(own) > 0 and all((points @ n).max() <= p @ n + room for n, p in planes)


def _lies_beside_spot(light: Light, triangles: SceneTriangles) -> bool:
    """Whether the ball around everything lies beside the cone of a spot."""
    parameters = mi.traverse(light.emitter)
    cutoff = math.radians(float(np.array(parameters["cutoff_angle"]).ravel()[0]))
    matrix = np.array(parameters["to_world"].matrix, dtype=np.float64).reshape(4, 4)
    low, high = triangles.bounds
    to_centre = 0.5 * (low + high) - matrix[:3, 3]
    distance, radius = float(np.linalg.norm(to_centre)), float(0.5 * np.linalg.norm(high - low))
    if distance <= radius:
        return False
    axis = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    angle = math.acos(float(np.clip(to_centre @ axis / distance, -1.0, 1.0)))
    return angle > cutoff + math.asin(radius / distance)
