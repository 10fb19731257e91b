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
from experiments.studies.derivatives.measure import forward_slope, moved_way
from experiments.studies.derivatives.room import SCENE_NAMES, derivative_room
from experiments.studies.derivatives.slopes import TABLE, Place, first_seed_count, slopes
from experiments.studies.figures import Table
from reports.study_figures import Bounded
from vctgi.clipmap.storage import StorageConfig
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

ROOM_NAMES = ("albedo of the walls", "radiance of the lamp", "roughness of the ball")
"""What is moved in the room of the other rows."""

QUICK = ("cornell_box", "radiance of the lamp")

EDGE = (64, 16)
"""Pixels along an edge, in the whole study and in the quick one."""

PATHS = (1024, 512)
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

PRB_TABLE = Table(
    group="Derivatives of scenes",
    title="Against path replay",
    caption="Derivatives of pictures of light of one bounce by the same parameters, by cones and "
    "by Mitsuba's prb: what differs is the bias of cones.",
    line_label="scene, parameter",
    columns=tuple(NUMBERS),
)


def checks(room_scene: str) -> list[Check]:
    """Return the checks against path tracing, in scenes and in the room of the other rows."""
    room = [
        Check(
            name=f"{name}, mean over prb's, less 1",
            configuration="one bounce, forward mode, 16 cones, without near field; bias of cones, "
            "no limit",
            scene=room_scene,
            measure=partial(_measure_room, name=name),
            goal=0.0,
            in_quick=False,
        )
        for name in ROOM_NAMES
    ]
    return room + [
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


def _measure_room(context: StudyContext, name: str) -> Measured:
    """Put the room's derivative by paths beside the others, and return how far cones are off it."""
    context.progress(f"room, {name}, prb", 0.0)
    room = derivative_room(context)
    room.restore()
    config = replace(room.config, samples_per_pixel=4)
    tangent = moved_way(room.scene_parameters[SCENE_NAMES[name]])
    pair = derivative_pair(room.scene, SCENE_NAMES[name], config, PATHS[0], tangent)
    place = Place(name)
    mean = float(np.mean(slopes(context, place, "mean", first_seed_count(context))))
    bias = Bounded(value=pair.energy())
    by_paths = Bounded(value=float(pair.paths.mean()) / mean)
    context.shelf.add_cells(TABLE, place.line, {"prb": by_paths, "bias": bias})
    return Measured(value=pair.energy())


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
        storage=StorageConfig(),
        reconstruction=replace(high.reconstruction, sparsity=1),
        samples_per_pixel=4,
    )
    pair = context.once(
        f"derivatives, prb, {scene}, {parameter}",
        lambda: derivative_pair(loaded, PARAMETERS[scene][parameter], config, paths),
    )
    _show(context, f"{scene}, {parameter}", pair, loaded.sensors()[0].film().crop_size())
    found = NUMBERS[number][0](pair)
    if np.isfinite(found):
        cells = {number: Bounded(value=found)}
        context.shelf.add_cells(PRB_TABLE, f"{scene}, {parameter}", cells)
    return Measured(value=found)


def _show(context: StudyContext, group: str, pair: Pair, size: mi.ScalarVector2u) -> None:
    """Keep both derivatives as pictures of one exposure."""
    width, height = (int(n) for n in size)
    paths, cones = (
        each.mean(axis=0).reshape(height, width, -1)[..., :3] for each in (pair.paths, pair.cones)
    )
    caption = "Derivative of indirect light by the parameter's share."
    context.shelf.add_picture(group, "prb", paths, caption=caption)
    context.shelf.add_picture(group, "Cones", cones, like=paths, caption=caption)


def derivative_pair(
    scene: mi.Scene, name: str, config: RenderConfig, path_count: int, tangent: Any = None
) -> Pair:
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
    tangent
        By how much the parameter's values grow with the share; None: by what they are.
    """
    parameters: Any = mi.traverse(scene)
    held = type(parameters[name])(parameters[name])
    # A leaf of the graph: Dr.Jit's forward mode refuses values behind others in calls of BSDFs
    value = type(held)(held)
    dr.enable_grad(value)
    parameters[name] = value
    parameters.update()
    moved = Moved(scene, value, held if tangent is None else tangent)
    count = config.scattering_count
    try:
        cones = [moved.by_cones(config, seed) for seed in (0, 1)]
        paths = [
            moved.by_paths(count + 1, path_count, seed) - moved.by_paths(2, path_count, seed)
            for seed in (0, 1)
        ]
    finally:
        parameters[name] = held
        parameters.update()
    return Pair(np.stack(cones), np.stack(paths))


@dataclass(frozen=True)
class Moved:
    """A scene one of whose values, with derivatives, becomes larger by a share of what it was."""

    scene: mi.Scene
    value: Any
    tangent: Any

    def by_cones(self, config: RenderConfig, seed: int) -> np.ndarray:
        """Return the derivative of a picture of indirect light."""
        prepared = prepare_scene(self.scene, self.scene.sensors()[0], config)
        volume = light_volume(prepared, config).volume
        frame = render_frame(prepared, volume, config, seed=seed)
        return self._slope(frame.indirect_diffuse.array + frame.indirect_specular.array)

    def by_paths(self, depth: int, count: int, seed: int) -> np.ndarray:
        """Return the derivative of a picture of all light up to a number of segments."""
        integrator = mi.load_dict({"type": "prb", "max_depth": depth, "rr_depth": depth + 1})
        render: Any = mi.render
        parameters = mi.traverse(self.scene)
        image = render(self.scene, parameters, integrator=integrator, spp=count, seed=seed)
        return self._slope(image.array)

    def _slope(self, numbers: Any) -> np.ndarray:
        dr.set_grad(self.value, self.tangent)
        return forward_slope(numbers)
