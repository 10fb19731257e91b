"""Sky: the environment averaged over cones, and how it lights voxels."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

import vctgi
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.light.bounces import energy_ratio, small_config
from vctgi.scene.sky import SkyConfig, cone_directions, environment_radiance, prefilter_sky

SKIES: dict[str, dict[str, Any]] = {
    "constant": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 2.0, 3.0]}},
    "sun and sky, the sun left out": {
        "type": "sunsky",
        "sun_scale": 0.0,
        "sun_direction": [0.3, 0.4, 0.8],
    },
}
"""Environments by name, as Mitsuba dictionaries."""

APERTURES = (2.0, 5.0, 11.0, 20.0, 30.0, 45.0, 60.0, 100.0, 180.0)
"""Full apex angles, degrees."""

LARGEST_ERROR, GOAL_ERROR = 0.05, 0.03
"""Root mean square over directions of the error, over the mean."""

LARGEST_BIAS = 0.005

AXIS_COUNT = 512
CONE_SAMPLES = (4096, 512)
"""Directions of the average by force, in the whole study and in the quick one."""

SKY_ENERGY = {"maps": (0.92, 1.08), "cones": (0.90, 1.10)}
"""Energy ratio of the open scene's indirect light."""

LARGEST_LEAK = 0.09
"""Of the sky into a closed room, by wide cones: 0 would be right."""


def checks() -> list[Check]:
    """Return the checks of the sky."""
    found = []
    for sky in SKIES:
        for name, measure, high, goal in (
            ("largest rms error over apertures", _rms, LARGEST_ERROR, GOAL_ERROR),
            ("largest bias over apertures", _bias, LARGEST_BIAS, 0.0),
        ):
            found.append(
                Check(
                    name=f"sky averaged over cones, {sky}, {name}",
                    configuration=f"maps of {SkyConfig().resolution} rows, cones of "
                    f"{APERTURES[0]:g} to {APERTURES[-1]:g} degrees against averages by force",
                    scene=sky,
                    measure=partial(measure, sky=sky),
                    limit_high=high,
                    goal=goal,
                )
            )
    for lighting, (low, high) in SKY_ENERGY.items():
        found.append(
            Check(
                name=f"sky on voxels by {lighting}, energy ratio",
                configuration='preset "high" with N = 64',
                scene="built-in open_sky, indirect light of two scatterings",
                measure=partial(_energy, lighting=lighting),
                limit_low=low,
                limit_high=high,
                goal=1.0,
            )
        )
    found.append(
        Check(
            name="sky into a closed room, leak",
            configuration='preset "high" with N = 64, sky in cones and on voxels by cones',
            scene="closed room two wide, albedo 0.6, over what an open wall would reflect",
            measure=_leak,
            limit_high=LARGEST_LEAK,
            goal=0.0,
        )
    )
    return found


def _errors(context: StudyContext, sky: str) -> list[tuple[float, float]]:
    """Root mean square error and bias for each aperture, over the mean."""

    def compare() -> list[tuple[float, float]]:
        scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere"}, "sky": SKIES[sky]})
        environment = scene.environment()
        filtered = prefilter_sky(environment, SkyConfig())
        axes = np.random.default_rng(1).normal(size=(AXIS_COUNT, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        axis = mi.Vector3f(np.ascontiguousarray(axes.T, dtype=np.float32))
        found = []
        for number, degrees in enumerate(APERTURES):
            context.progress("averages by force", number / len(APERTURES))
            aperture = math.radians(degrees)
            exact = by_force(environment, axis, aperture, CONE_SAMPLES[context.quick])
            read = np.array(filtered.read(axis, mi.Float(aperture)), dtype=np.float64).T
            rms = float(np.sqrt(np.mean((read - exact) ** 2)))
            found.append((rms / exact.mean(), abs(float(read.mean() / exact.mean()) - 1.0)))
        return found

    return context.once(f"sky, {sky}", compare)


def by_force(environment: mi.Emitter, axis: mi.Vector3f, aperture: float, count: int) -> np.ndarray:
    """Mean radiance [axis, rgb] over cones, the emitter asked in many directions."""
    frame = mi.Frame3f(axis)
    width = dr.width(axis)
    total = dr.zeros(mi.Color3f, width)
    for local in cone_directions(aperture, count):
        x, y, z = (dr.opaque(mi.Float, each) for each in local)
        total += environment_radiance(environment, frame.to_world(mi.Vector3f(x, y, z)))
        dr.eval(total)
    return np.array(total, dtype=np.float64).T / count


def _rms(context: StudyContext, sky: str) -> Measured:
    return Measured(value=max(rms for rms, _ in _errors(context, sky)))


def _bias(context: StudyContext, sky: str) -> Measured:
    return Measured(value=max(bias for _, bias in _errors(context, sky)))


def _energy(context: StudyContext, lighting: str) -> Measured:
    return energy_ratio(context, "open_sky", small_config(sky_lighting=lighting))


def _leak(_context: StudyContext) -> Measured:
    albedo = 0.6
    cube = {
        "type": "cube",
        "flip_normals": True,
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": albedo}},
    }
    eye = {
        "type": "perspective",
        "fov": 120.0,
        "to_world": mi.ScalarTransform4f().look_at([0.5, 0.5, 0.5], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}},
    }
    sky = {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}
    scene = mi.load_dict({"type": "scene", "room": cube, "eye": eye, "sky": sky})
    config = replace(small_config(sky_lighting="cones"), sky_in_cones=True)
    prepared = vctgi.prepare_scene(scene, scene.sensors()[0], config)
    frame = vctgi.render_frame(prepared, vctgi.light_volume(prepared, config).volume, config)
    return Measured(value=float(np.array(frame.indirect_diffuse).mean()) / albedo)
