"""Light from outside that walls and a roof stop: a hall with a slit, under an even sky.

What passes the slit is known: radiance times pi times its area, as the hall is convex.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.scene.lights import list_lights
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.scene.triangles import extract_triangles
from vctgi.stages.light_injection import inject_light
from vctgi.stages.reflective_shadow_map import (
    ReflectiveShadowMapConfig,
    render_reflective_shadow_maps,
)
from vctgi.stages.voxelization.opacity import voxelize_opacity

SLIT = 0.2
"""Width of the slit in the roof of a hall two wide, high and deep."""

RADIANCE = 2.0

CONFIGURATION = "default maps, finest of three levels of 64^3, which holds a quarter of the floor"
SCENE = "closed hall two wide with a slit of 0.2 in its roof, under an even sky"

TRUTH_FACTOR = 4.0
"""Texels along an edge of the dense map over those of the map in question."""

LEAST_LANDING, GOAL_LANDING = 0.5, 1.0
"""Texels that land in the window, over those that a full map has."""

MOST_DARK = 0.01
MOST_NOISE = 0.1
ENERGY_WITHIN = 0.01

LIT_SHARE, SOLID_OPACITY = 0.02, 0.5
"""A slot is lit when it has this share of the mean; solid when it is this opaque."""


def checks() -> list[Check]:
    """Return the checks on light from outside."""
    return [
        Check(
            name="sky through a slit, texels in the window over a full map",
            configuration=CONFIGURATION,
            scene=SCENE,
            measure=_landing,
            limit_low=LEAST_LANDING,
            goal=GOAL_LANDING,
        ),
        Check(
            name="sky through a slit, solid lit slots without a texel",
            configuration=f"{CONFIGURATION}; lit in a map of {TRUTH_FACTOR**2:g} times the texels",
            scene=SCENE,
            measure=_dark,
            limit_high=MOST_DARK,
            goal=0.0,
        ),
        Check(
            name="sky through a slit, noise of emittance",
            configuration=f"{CONFIGURATION}; squared difference from a map of {TRUTH_FACTOR**2:g} "
            "times the texels over its sum of squares",
            scene=SCENE,
            measure=_noise,
            limit_high=MOST_NOISE,
        ),
        Check(
            name="sky through a slit, energy",
            configuration="default maps, coarsest of three levels; what lands inside, over the "
            "closed form",
            scene=SCENE,
            measure=_energy,
            limit_low=1.0 - ENERGY_WITHIN,
            limit_high=1.0 + ENERGY_WITHIN,
            goal=1.0,
        ),
    ]


@dataclass(frozen=True)
class Court:
    """Maps of the hall, and the emittance [slot] of its finest level by default and dense ones."""

    maps: list[ReflectiveShadowMap]
    found: np.ndarray
    dense: np.ndarray
    opacity: np.ndarray


def _court(context: StudyContext) -> Court:
    return context.once("light, court", partial(_light_court, context))


def _light_court(context: StudyContext) -> Court:
    scene = _hall()
    layout = lay_out_clipmap((0.0, -0.6, 0.0), finest_voxel_size=0.02, level_count=3, resolution=64)
    opacity = voxelize_opacity(opaque_surfaces(extract_triangles(scene).vertices), layout)
    context.progress("court", 0.0)
    config = ReflectiveShadowMapConfig()
    maps = render_reflective_shadow_maps(scene, list_lights(scene), layout, config, opacity)
    fine = ReflectiveShadowMapConfig(
        texels_per_voxel=TRUTH_FACTOR * config.texels_per_voxel, max_texel_count=1 << 26
    )
    finest = render_reflective_shadow_maps(scene, list_lights(scene), layout, fine, opacity)
    dense = [each for each in finest if each.level == 0]
    found, truth = (
        np.array(inject_light(each, opacity).levels[0].y, dtype=np.float64)
        for each in (maps, dense)
    )
    return Court(maps, found, truth, np.array(opacity.levels[0], dtype=np.float64))


def _hall() -> mi.Scene:
    """Return the hall; all its surfaces face inwards."""
    place = mi.ScalarTransform4f
    half = 0.5 * (1.0 - 0.5 * SLIT)
    parts = {
        f"wall{quarter}": place().rotate([0, 1, 0], 90.0 * quarter).translate([0, 0, -1])
        for quarter in range(4)
    }
    parts["floor"] = place().rotate([1, 0, 0], -90.0).translate([0, 0, -1])
    for side in (-1.0, 1.0):
        roof = place().translate([side * (1.0 - half), 1.0, 0.0]).rotate([1, 0, 0], 90.0)
        parts[f"roof{side:g}"] = roof.scale([half, 1.0, 1.0])
    shapes = {name: {"type": "rectangle", "to_world": to} for name, to in parts.items()}
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": RADIANCE}}
    scene: mi.Scene = mi.load_dict({"type": "scene", "sky": sky, **shapes})
    return scene


def _landing(context: StudyContext) -> Measured:
    (finest,) = (each for each in _court(context).maps if each.level == 0)
    full = (ReflectiveShadowMapConfig().texels_per_voxel * 64) ** 2
    return Measured(value=finest.texel_count / full)


def _dark(context: StudyContext) -> Measured:
    court = _court(context)
    is_lit = court.dense > LIT_SHARE * court.dense[court.dense > 0.0].mean()
    is_lit &= court.opacity > SOLID_OPACITY
    return Measured(value=float((court.found[is_lit] == 0.0).mean()))


def _noise(context: StudyContext) -> Measured:
    court = _court(context)
    error = ((court.found - court.dense) ** 2).sum() / (court.dense**2).sum()
    return Measured(value=float(error))


def _energy(context: StudyContext) -> Measured:
    (coarsest,) = (each for each in _court(context).maps if each.level == 2)
    position, normal = (
        np.array(each, dtype=np.float64) for each in (coarsest.position, coarsest.normal)
    )
    flux = np.array(coarsest.incident_flux.y, dtype=np.float64)
    is_inside = np.einsum("ij,ij->j", position, normal) < 0.0
    through = math.pi * RADIANCE * SLIT * 2.0
    return Measured(value=float(flux[is_inside].sum()) / through)
