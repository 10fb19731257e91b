"""What a scene needs, and what is left out because it does not.

The plan looks at the scene once. The pipeline runs only what it keeps, and the kernels contain no
code for the rest. It is data: it prints as a table and stands in every record.
"""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import (
    WINDOW_MARGIN_VOXELS,
    ClipmapConfig,
    ClipmapLayout,
    lay_out_clipmap,
)
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.plan_entries import PlanEntry as PlanEntry
from vctgi.plan_entries import (
    ambient_entries,
    anisotropy_entries,
    bounce_entry,
    emission_entry,
    sky_entries,
    sparse_entry,
)
from vctgi.scene.camera import survey_rays, viewer
from vctgi.scene.lights import Light
from vctgi.scene.materials import Material
from vctgi.scene.triangles import SceneTriangles
from vctgi.stages.reflective_shadow_map import survey_distant, survey_lamps

SURVEY_RESOLUTION = 64
"""Camera rays along an edge of the picture that the clipmap is fitted to."""

NEAR_SHARE = 0.8
"""Share of the visible points, nearest first, that the finest level holds."""

MAX_FAR_RATIO = 1e4
"""Largest scene extent over finest level extent that is worth a level of its own."""

LAMP_SURVEY_EDGES = (32, 128)
"""Rays along an edge of the map by which a lamp is judged; the second where none of the first
landed."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is run for a scene.

    Attributes
    ----------
    layout
        Windows of the clipmap.
    has_specular
        Whether glossy or mirror lobes are traced.
    has_passing
        Whether light that passes straight through masks and thin glass is traced.
    lights
        Emitters that get a reflective shadow map.
    has_sky_in_cones
        Whether cones that leave the clipmap see the environment.
    has_sky_by_cones
        Whether the environment lights voxels by their own cones, not by a map.
    bounce_count
        Most scatterings from voxel to voxel.
    entries
        The decisions in words.
    """

    layout: ClipmapLayout
    has_specular: bool
    has_passing: bool
    lights: tuple[Light, ...]
    has_sky_in_cones: bool
    has_sky_by_cones: bool
    bounce_count: int
    entries: tuple[PlanEntry, ...]


def plan_render(
    scene: mi.Scene,
    sensor: mi.Sensor,
    triangles: SceneTriangles,
    materials: list[Material],
    lights: list[Light],
    config: RenderConfig,
) -> Plan:
    """Decide what a scene needs.

    Parameters
    ----------
    scene, sensor
        Scene and camera.
    triangles, materials, lights
        What was read off the scene.
    config
        What is asked for; what it leaves open about the clipmap is chosen here.
    """
    layout, layout_entries = _choose_layout(scene, sensor, triangles, config.clipmap)
    if config.mode == "ambient":
        entries = [*layout_entries, *ambient_entries(config), sparse_entry(config)]
        return _ambient_plan(layout, entries)
    has_sky = scene.environment() is not None
    by_cones = has_sky and config.sky_lighting == "cones"
    kept_lights, light_entries = _choose_lights(scene, lights, layout)
    mapped = [each for each in kept_lights if not (by_cones and each.emitter.is_environment())]
    glossy = [m.kind for m in materials if m.has_specular]
    passing = [m.kind for m in materials if m.has_null]
    entries = [
        *layout_entries,
        PlanEntry(
            item="specular cones",
            kept=bool(glossy),
            reason=f"materials with glossy lobes: {', '.join(sorted(set(glossy)))}"
            if glossy
            else "no material has a glossy or mirror lobe",
            saved="" if glossy else "one cone a pixel and the measuring of lobes",
        ),
        *anisotropy_entries(materials),
        PlanEntry(
            item="cones through masks and thin glass",
            kept=bool(passing),
            reason=f"materials that let light pass: {', '.join(sorted(set(passing)))}"
            if passing
            else "no material lets light pass straight through",
            saved="" if passing else "one cone a pixel and alpha tests in voxelization",
        ),
        PlanEntry(
            item="reflective shadow maps",
            kept=bool(mapped),
            reason=f"{len(mapped)} emitters",
        ),
        *light_entries,
        bounce_entry(config),
        emission_entry(config),
        *sky_entries(config, has_sky=has_sky),
        sparse_entry(config),
    ]
    return Plan(
        layout=layout,
        has_specular=bool(glossy),
        has_passing=bool(passing),
        lights=tuple(mapped),
        has_sky_in_cones=has_sky and config.sky_in_cones,
        has_sky_by_cones=by_cones,
        bounce_count=config.bounce_count,
        entries=tuple(entries),
    )


def _ambient_plan(layout: ClipmapLayout, entries: list[PlanEntry]) -> Plan:
    """Return the plan of a frame without light."""
    return Plan(
        layout=layout,
        has_specular=False,
        has_passing=False,
        lights=(),
        has_sky_in_cones=False,
        has_sky_by_cones=False,
        bounce_count=0,
        entries=tuple(entries),
    )


def _choose_layout(
    scene: mi.Scene, sensor: mi.Sensor, triangles: SceneTriangles, config: ClipmapConfig
) -> tuple[ClipmapLayout, list[PlanEntry]]:
    """Fit the finest level to what the camera sees nearby, and add levels until all is held."""
    low, high = triangles.bounds
    near_low, near_high = _near_bounds(scene, sensor, low, high)
    usable = config.resolution - 2.0 * WINDOW_MARGIN_VOXELS
    smallest = float(np.max(high - low)) / MAX_FAR_RATIO
    voxel_size = config.finest_voxel_size or (
        max(float(np.max(near_high - near_low)), smallest) / usable
    )
    middle = 0.5 * (near_low + near_high)
    if config.ahead is not None:
        position, forward = viewer(sensor)
        middle = position + config.ahead * 0.5 * config.resolution * voxel_size * forward
    x, y, z = middle.tolist()
    centre = config.centre or (x, y, z)

    def lay_out(level_count: int) -> ClipmapLayout:
        return lay_out_clipmap(
            centre,
            finest_voxel_size=voxel_size,
            level_count=level_count,
            resolution=config.resolution,
        )

    counts = [config.level_count] if config.level_count else range(1, config.max_level_count + 1)
    layouts = [lay_out(count) for count in counts]
    layout = next((each for each in layouts if _holds(each, low, high)), layouts[-1])
    reason = f"finest voxel {voxel_size:.4g}, coarsest window {_extent(layout):.4g} world units"
    entries = [PlanEntry(item=f"{layout.clip_level_count} clip levels", kept=True, reason=reason)]
    left_out = config.max_level_count - layout.clip_level_count
    if not _holds(layout, low, high):
        entries.append(
            PlanEntry(
                item="geometry outside the coarsest window",
                kept=False,
                reason=f"the scene extends over {float(np.max(high - low)):.4g} world units; "
                "raise clipmap.max_level_count to hold it",
                saved="further levels",
            )
        )
    elif left_out > 0 and not config.level_count:
        entries.append(
            PlanEntry(
                item=f"{left_out} further clip levels",
                kept=False,
                reason="the coarsest window holds the whole scene",
                saved=f"{left_out * config.resolution**3:,} voxels",
            )
        )
    return layout, entries


def _choose_lights(
    scene: mi.Scene, lights: list[Light], layout: ClipmapLayout
) -> tuple[list[Light], list[PlanEntry]]:
    """Leave out lights without power and lamps that reach nothing.

    Raises
    ------
    SceneError
        A power that is negative, infinite or NaN; a lamp that only shines on backs.
    """
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
    unreached = [light for light in lamps if power[id(light)] != 0.0]
    for light in lights:
        if not 0.0 <= power[id(light)] < float("inf"):
            raise SceneError(
                "its power is negative, infinite or NaN",
                f"emitter '{light.name}'",
                "correct its radiance",
            )
    dark = [light for light in lights if power[id(light)] == 0.0]
    left_out = {
        "lights without power": (dark, "their power is zero"),
        "lights that reach nothing": (unreached, "no ray of them meets a surface"),
    }
    entries = [
        PlanEntry(
            item=item,
            kept=False,
            reason=f"{reason}: {', '.join(each.name for each in chosen)}",
            saved="their reflective shadow maps",
        )
        for item, (chosen, reason) in left_out.items()
        if chosen
    ]
    gone = {id(light) for light in [*dark, *unreached]}
    return [light for light in lights if id(light) not in gone], entries


def _near_bounds(
    scene: mi.Scene, sensor: mi.Sensor, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the nearest visible points, or of the scene where none is visible."""
    si = scene.ray_intersect(survey_rays(sensor, SURVEY_RESOLUTION))
    is_hit = np.array(si.is_valid())
    if not is_hit.any():
        return low, high
    points = np.array(si.p, dtype=np.float64).T[is_hit]
    depth = np.array(si.t, dtype=np.float64)[is_hit]
    near = points[depth <= np.quantile(depth, NEAR_SHARE)]
    return near.min(axis=0), near.max(axis=0)


def _holds(layout: ClipmapLayout, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether the coarsest window holds a box."""
    box = layout.coarsest
    return bool(np.all(low >= box.window_min) and np.all(high <= box.window_max))


def _extent(layout: ClipmapLayout) -> float:
    return layout.extent
