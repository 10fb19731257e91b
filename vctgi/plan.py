"""What a scene needs, and what is left out because it does not.

The plan looks at the scene once. The pipeline runs only what it keeps, and the kernels contain no
code for the rest. It is data: it prints as a table and stands in every record. What may be left
out, and how far that moves the picture, is `vctgi.eliminations`; `RenderConfig.keep` overrides it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import mitsuba as mi

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.stored_directions import StoredDirections
from vctgi.config import RenderConfig
from vctgi.eliminations import EXACT
from vctgi.plan_directions import choose_directions
from vctgi.plan_entries import PlanEntry as PlanEntry
from vctgi.plan_entries import (
    ambient_entries,
    anisotropy_entries,
    bounce_entry,
    emission_entry,
    needed_entry,
    sky_entries,
    sparse_entry,
)
from vctgi.plan_layout import choose_layout
from vctgi.plan_lights import choose_lights
from vctgi.scene.constants import is_dark
from vctgi.scene.emissive import list_emissive_surfaces
from vctgi.scene.lights import Light
from vctgi.scene.materials import Material
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.scene.triangles import SceneTriangles

TEXTURE_COORDINATE_BYTES = 24
"""Of a triangle: three pairs in single precision."""

OPAQUE_MASKS_BOUND = "albedo within 2^-20 of itself"
"""Lobes of a mask that is opaque all over are one sample in the place of a mean of many."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is run for a scene.

    Attributes
    ----------
    layout
        Windows of the clipmap.
    directions
        Which directions of voxels are stored; None: as many as the storage says.
    has_specular
        Whether glossy or mirror lobes are traced.
    has_passing
        Whether light that passes straight through masks and thin glass is traced.
    is_lit
        Whether voxels get light.
    lights
        Emitters that get a reflective shadow map.
    has_emission
        Whether surfaces shine from voxels.
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
    directions: StoredDirections | None
    has_specular: bool
    has_passing: bool
    is_lit: bool
    lights: tuple[Light, ...]
    has_emission: bool
    has_sky_in_cones: bool
    has_sky_by_cones: bool
    bounce_count: int
    entries: tuple[PlanEntry, ...]


@dataclass(frozen=True, kw_only=True)
class SceneParts:
    """What was read off a scene.

    Attributes
    ----------
    triangles, materials, surfaces, lights
        Geometry, its BSDFs, the sides of it that are voxelized, all emitters.
    """

    triangles: SceneTriangles
    materials: list[Material]
    surfaces: VoxelSurfaces
    lights: list[Light]


def plan_render(
    scene: mi.Scene, sensor: mi.Sensor, parts: SceneParts, config: RenderConfig
) -> Plan:
    """Decide what a scene needs.

    Parameters
    ----------
    scene, sensor
        Scene and camera.
    parts
        What was read off the scene.
    config
        What is asked for; what it leaves open about the clipmap is chosen here.
    """
    layout, layout_entries = choose_layout(scene, sensor, parts.triangles, config)
    directions, direction_entries = choose_directions(parts.surfaces, config)
    is_ambient = config.mode == "ambient"
    is_lit = not is_ambient or config.is_kept("light")
    glossy = _kinds(m for m in parts.materials if m.has_specular)
    passing = _kinds(m for m in parts.materials if m.has_null)
    environment = scene.environment()
    has_sky = environment is not None and not is_dark(environment)
    lights, light_entries = (
        choose_lights(scene, parts.lights, layout, parts.triangles, config) if is_lit else ([], [])
    )
    by_cones = config.sky_lighting == "cones"
    mapped = [each for each in lights if not (by_cones and each.emitter.is_environment())]
    emissive = _emissive_count(scene) if config.emission_in_voxels and is_lit else 0
    entries = [*layout_entries, *direction_entries, _texture_entry(parts, config)]
    if is_ambient:
        entries += [*ambient_entries(config), sparse_entry(config)]
    else:
        entries += [
            _specular_entry(glossy, config),
            *anisotropy_entries(parts.materials),
            _alpha_entry(passing, parts.materials, config),
            PlanEntry(
                item="reflective shadow maps", kept=bool(mapped), reason=f"{len(mapped)} emitters"
            ),
            *light_entries,
            bounce_entry(config),
            emission_entry(config, emissive),
            *sky_entries(config, has_sky=has_sky, lacks=_lacks_sky(environment)),
            sparse_entry(config),
        ]
    sees_sky = is_lit and (has_sky or config.is_kept("sky"))
    return Plan(
        layout=layout,
        directions=directions,
        has_specular=not is_ambient and (bool(glossy) or config.is_kept("specular")),
        has_passing=not is_ambient and (bool(passing) or config.is_kept("alpha")),
        is_lit=is_lit,
        lights=tuple(mapped),
        has_emission=is_lit
        and config.emission_in_voxels
        and (emissive > 0 or config.is_kept("emission")),
        has_sky_in_cones=sees_sky and config.sky_in_cones,
        has_sky_by_cones=sees_sky and by_cones,
        bounce_count=config.bounce_count if is_lit else 0,
        entries=tuple(entries),
    )


def _kinds(materials: Iterable[Material]) -> str:
    """Names of the kinds of materials, each once."""
    return ", ".join(sorted({material.kind for material in materials}))


def _emissive_count(scene: mi.Scene) -> int:
    return len(list_emissive_surfaces(scene).emitter_number)


def _lacks_sky(environment: mi.Emitter | None) -> str:
    if environment is None:
        return "the scene has no environment"
    return "the environment's radiance is zero all over"


def _specular_entry(glossy: str, config: RenderConfig) -> PlanEntry:
    return needed_entry(
        "specular",
        config,
        item="specular cones",
        needs=f"materials with glossy lobes: {glossy}" if glossy else "",
        lacks="no material has a glossy or mirror lobe",
        saved="the cones of a lobe, their filter and the measuring of lobes",
    )


def _alpha_entry(passing: str, materials: list[Material], config: RenderConfig) -> PlanEntry:
    has_opaque_masks = any(material.is_opaque_mask for material in materials)
    lacks = "no material lets light pass straight through"
    return needed_entry(
        "alpha",
        config,
        item="cones through masks and thin glass",
        needs=f"materials that let light pass: {passing}" if passing else "",
        lacks=lacks + ("; masks are opaque all over" if has_opaque_masks else ""),
        saved="one cone a pixel and alpha tests in voxelization",
        bound=OPAQUE_MASKS_BOUND if has_opaque_masks else EXACT,
    )


def _texture_entry(parts: SceneParts, config: RenderConfig) -> PlanEntry:
    count = len(parts.surfaces.vertices)
    return needed_entry(
        "textures",
        config,
        item="texture coordinates for voxelization",
        needs="alpha masks read them" if parts.surfaces.masks else "",
        lacks="no alpha mask reads them",
        saved=f"{TEXTURE_COORDINATE_BYTES * count:,} bytes of {count:,} sides",
    )
