"""Derivatives by parameters of scenes, through cones and through Mitsuba's path replay (`prb`).

Both are of the light that is scattered as often: paths of at most three segments less those of at
most two, from the same random numbers, which leaves what cones carry of one bounce. The difference
is the bias of cones, so the rows have no limit. Derivatives are pictures, by the share by which a
parameter becomes larger; products are of independent pairs, in which no noise has a bias.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.scenes.loading import load_scene
from experiments.studies.check import Check, Measured, StudyContext
from vctgi.config import RenderConfig, preset
from vctgi.pipeline import light_volume, prepare_scene, render_frame

PARAMETERS = {
    "cornell_box": {
        "albedo of the white walls": "white.reflectance.value",
        "albedo of the red wall": "red.reflectance.value",
        "radiance of the lamp": "light.emitter.radiance.value",
    },
    "sealed_rooms": {
        "albedo of the west wall": "west.bsdf.reflectance.value",
        "radiance of the lamp": "light.emitter.radiance.value",
    },
    "glossy_floor": {
        "albedo of the ball": "ball.bsdf.reflectance.value",
        "reflectance of the floor": "floor.bsdf.specular_reflectance.value",
        "radiance of the lamp": "light.emitter.radiance.value",
    },
    "small_light": {
        "albedo of the east wall": "east.bsdf.reflectance.value",
        "intensity of the bulb": "light.intensity.value",
        "radiance of the lamp": "object.emitter.radiance.value",
    },
    "open_sky": {
        "albedo of the ground": "ground.bsdf.reflectance.value",
        "irradiance of the sun": "sun.irradiance.value",
    },
    "corridor": {"radiance of a lamp": "light_0.emitter.radiance.value"},
}
"""What is moved in each built-in scene, by what `mi.traverse` calls it."""

QUICK = ("cornell_box", "radiance of the lamp")

EDGE = (32, 16)
"""Pixels along an edge, in the whole study and in the quick one."""

PATHS = (2048, 512)
"""Paths a pixel of each half of a reference."""

VOXELS = (64, 32)
"""Voxels along an edge of a level."""


@dataclass(frozen=True)
class Pair:
    """Two independent renderings each, [rendering, number], in double precision.

    Attributes
    ----------
    cones, paths
        Derivatives of the pictures.
    """

    cones: np.ndarray
    paths: np.ndarray

    def energy(self) -> float:
        """Return by which share the mean derivative is off."""
        return float(self.cones.mean() / self.paths.mean() - 1.0)

    def cosine(self) -> float:
        """Return the cosine of the angle between both pictures, noise taken off."""
        across = float(np.mean([np.dot(v, r) for v in self.cones for r in self.paths]))
        own = float(np.dot(*self.cones)) * float(np.dot(*self.paths))
        return float(across / np.sqrt(own))

    def squared_error(self) -> float:
        """Return the squared difference over the squared derivative, noise taken off."""
        gap = self.cones - self.paths
        return float(np.dot(*gap) / np.dot(*self.paths))


NUMBERS = {
    "mean over prb's, less 1": (Pair.energy, 0.0),
    "cosine with prb's": (Pair.cosine, 1.0),
    "squared difference from prb's, over its square": (Pair.squared_error, 0.0),
}
"""What is said of a pair, and what it would be without bias."""


def checks() -> list[Check]:
    """Return the checks against path tracing."""
    return [
        Check(
            name=f"{scene}, {parameter}: {number}",
            configuration="preset high, one bounce, forward mode; bias of cones, no limit",
            scene=f"{scene}, {EDGE[0]} pixels along the edge",
            measure=partial(_measure, scene=scene, parameter=parameter, number=number),
            goal=NUMBERS[number][1],
            in_quick=(scene, parameter) == QUICK,
        )
        for scene, parameters in PARAMETERS.items()
        for parameter in parameters
        for number in NUMBERS
    ]


def _measure(context: StudyContext, scene: str, parameter: str, number: str) -> Measured:
    edge, paths, voxels = (each[int(context.quick)] for each in (EDGE, PATHS, VOXELS))
    context.progress(f"{scene}, {parameter}", 0.0)
    loaded = context.once(
        f"derivatives, prb, {scene}", lambda: load_scene(scene, resolution=edge).scene
    )
    high = preset("high")
    config = replace(
        high,
        clipmap=replace(high.clipmap, resolution=voxels),
        reconstruction=replace(high.reconstruction, sparsity=1),
        samples_per_pixel=4,
    )
    pair = context.once(
        f"derivatives, prb, {scene}, {parameter}",
        lambda: derivative_pair(loaded, PARAMETERS[scene][parameter], config, paths),
    )
    return Measured(value=NUMBERS[number][0](pair))


def derivative_pair(scene: mi.Scene, name: str, config: RenderConfig, path_count: int) -> Pair:
    """Return derivatives of indirect light by a parameter's share, both ways.

    Parameters
    ----------
    scene
        Unchanged afterwards.
    name
        The parameter, as `mi.traverse` calls it.
    config
        How cones render.
    path_count
        Paths a pixel of each of both references.
    """
    parameters: Any = mi.traverse(scene)
    held = type(parameters[name])(parameters[name])
    share = dr.opaque(mi.Float, 0.0)
    dr.enable_grad(share)
    parameters[name] = held * (1.0 + share)
    parameters.update()
    count = config.scattering_count
    cones = [_by_cones(scene, share, config, seed) for seed in (0, 1)]
    paths = [
        _by_paths(scene, share, count + 1, path_count, seed)
        - _by_paths(scene, share, 2, path_count, seed)
        for seed in (0, 1)
    ]
    parameters[name] = held
    parameters.update()
    return Pair(np.stack(cones), np.stack(paths))


def _by_cones(scene: mi.Scene, share: mi.Float, config: RenderConfig, seed: int) -> np.ndarray:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume
    frame = render_frame(prepared, volume, config, seed=seed)
    return _slope(frame.indirect_diffuse.array + frame.indirect_specular.array, share)


def _by_paths(scene: mi.Scene, share: mi.Float, depth: int, count: int, seed: int) -> np.ndarray:
    integrator = mi.load_dict({"type": "prb", "max_depth": depth, "rr_depth": depth + 1})
    render: Any = mi.render
    image = render(scene, mi.traverse(scene), integrator=integrator, spp=count, seed=seed)
    return _slope(image.array, share)


def _slope(numbers: Any, share: mi.Float) -> np.ndarray:
    dr.set_grad(share, 1.0)
    return np.array(dr.forward_to(numbers, flags=dr.ADFlag.ClearInterior), dtype=np.float64)
