"""One emitter of each kind in a half open court: its picture beside the path-traced one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import mitsuba as mi
import numpy as np

import reference
import vctgi
from experiments.run import component_images
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.light.bounces import small_config
from experiments.studies.light.emitters import lit_scenes, room_walls

GREY = [0.6, 0.6, 0.6]
WALLS = {"wall0": GREY, "wall1": [0.7, 0.2, 0.15], "wall3": [0.2, 0.5, 0.2], "wall5": GREY}
"""Reflectances of the sides of a closed room that a court has: back, left, right and floor."""

UNSEEN = "directional area"
"""Mitsuba's path tracer finds no light of this kind, which has a direction but no solid angle."""

IN_QUICK = ("point", "constant")
"""A lamp and a light from outside, of which the quick study has a picture."""

EDGE = (96, 64)
"""Pixels along an edge of a picture, in the whole study and in the quick one."""

PATH_COUNT = (1024, 128)
BATCH_COUNT = 8

ENERGY_WITHIN = 0.15
"""Of the indirect light of 17 cones in 64 voxels, in a scene with open edges."""


@dataclass
class _Pair:
    """A picture by cones and its twin by path tracing, and the indirect light of both."""

    cones: np.ndarray
    paths: np.ndarray
    energy: Measured


def checks() -> list[Check]:
    """Return the check of each kind of emitter that a path tracer can see."""
    return [
        Check(
            name=f"picture, {kind}, energy ratio",
            configuration='preset "high" with N = 64',
            scene="court of two coloured walls, indirect light of two scatterings",
            measure=partial(_energy, kind=kind),
            limit_low=1.0 - ENERGY_WITHIN,
            limit_high=1.0 + ENERGY_WITHIN,
            goal=1.0,
            in_quick=kind in IN_QUICK,
        )
        for kind in lit_scenes()
        if kind != UNSEEN
    ]


def court(kind: str, edge: int) -> mi.Scene:
    """Return a court without a front and a ceiling, lit by one emitter."""
    parts: dict[str, Any] = {
        "type": "scene",
        "light": lit_scenes()[kind].parts["light"],
        "ball": {
            "type": "sphere",
            "center": [-0.5, -0.7, -0.4],
            "radius": 0.3,
            "bsdf": _diffuse(GREY),
        },
        "eye": {
            "type": "perspective",
            "fov": 45.0,
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 3.4], [0, -0.1, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": edge, "height": edge, "rfilter": {"type": "box"}},
        },
    }
    for name, wall in room_walls().items():
        if name in WALLS:
            parts[name] = {**wall, "bsdf": _diffuse(WALLS[name])}
    scene: mi.Scene = mi.load_dict(parts)
    return scene


def _diffuse(colour: list[float]) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}}


def _energy(context: StudyContext, kind: str) -> Measured:
    pair = _render(context, kind)
    group = f"Light of one emitter: {kind}"
    context.shelf.add_picture(group, "Cones", pair.cones, like=pair.paths)
    context.shelf.add_picture(group, "Path tracing", pair.paths, like=pair.paths)
    return pair.energy


def _render(context: StudyContext, kind: str) -> _Pair:
    scene, config = court(kind, EDGE[context.quick]), small_config()
    prepared = vctgi.prepare_scene(scene, scene.sensors()[0], config)
    frame = vctgi.render_frame(prepared, vctgi.light_volume(prepared, config).volume, config)
    truth = reference.render_reference(
        scene,
        sensor=0,
        request=reference.ReferenceRequest(
            samples_per_pixel=PATH_COUNT[context.quick],
            batch_count=BATCH_COUNT,
            scattering_count=config.scattering_count,
            seed=0,
        ),
        cache_directory=None,
        progress=lambda share: context.progress(f"path tracing, {kind}", share),
    )
    indirect = component_images(frame)["indirect"]
    batches = truth.batches("indirect")
    shared = truth.mean("emission") + truth.mean("direct")
    ratios = [float(indirect.mean() / each.mean()) for each in batches]
    return _Pair(indirect + shared, batches.mean(axis=0) + shared, mean_of(ratios))
