"""Derivatives by where things are, what fills voxels, and what textures hold.

The light of a scene whose lamp moves is summed from points that pass from voxel to voxel, so a
picture is a staircase of very low steps, however smooth its trend: differences of steps of 0.001
measure the steps. What moves is therefore compared over an interval: its difference is the mean of
the derivatives inside, by three points of Gauss. An empty room has no shadows and no outlines; with
a box in it what the box hides changes, which derivatives do not see, and the row says the bias.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.derivatives.measure import (
    MODES,
    Picture,
    by_differences,
    disagreement,
    mean_picture,
    moved,
)
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.stages.cone_tracing.diffuse_config import DiffuseConesConfig
from vctgi.stages.light_injection import LightInjectionConfig
from vctgi.stages.reconstruction.config import ReconstructionConfig
from vctgi.stages.reflective_shadow_map import ReflectiveShadowMapConfig
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig

STEP = 1e-4
"""Relative step of the differences by parameters of the renderer."""

SCALE_STEP = 1e-3
"""The same by numbers of the scene, by which pictures are smooth. With a step of 1e-4 roundings of
single precision are 2 to 5 % of the roughness's differences, of 3e-4 they are 0.2 % (two cores)."""

REACH = 0.05
"""Half the interval over which what moves is followed, in world units of a room two wide."""

GAUSS = ((-math.sqrt(0.6), 5.0 / 18.0), (0.0, 8.0 / 18.0), (math.sqrt(0.6), 5.0 / 18.0))
"""Places in (-1, 1) and weights of a mean by three points."""

POINTS = (0.93, 1.0, 1.07)
"""Factors on a parameter's value at which derivatives are taken."""

LIMIT = 0.05
"""How far a derivative may be off."""

SCENE = "room two wide, turned by 33 degrees, 24 x 24 pixels"

CONFIG = RenderConfig(
    clipmap=ClipmapConfig(
        resolution=32, finest_voxel_size=0.12, centre=(0.0, 0.0, 0.0), level_count=1
    ),
    diffuse=DiffuseConesConfig(cone_count=9),
    samples_per_pixel=1,
    reflective_shadow_map=ReflectiveShadowMapConfig(texels_per_voxel=32.0, texels_per_face=1024.0),
    voxelization=OpacityVoxelizationConfig(coverage="analytic"),
)
"""Many texels, so that the steps of the staircase are low."""


@dataclass(frozen=True)
class Case:
    """A parameter in a scene.

    Attributes
    ----------
    lamp
        Name of a light of `LAMPS`.
    name
        Of the parameter: one of `ConeParameters`, or the end of what `mi.traverse` shows.
    config
        How it is rendered.
    way
        World direction in which the parameter moves; none for parameters of the renderer and for
        scales.
    has_box
        Whether a box stands in the room, whose shadow and outline move or are seen to.
    is_biased
        Whether derivatives are known to be off, and so have no limit.
    """

    lamp: str
    name: str
    config: RenderConfig = CONFIG
    way: tuple[float, float, float] | None = None
    has_box: bool = False
    is_biased: bool = False


SPARSE = replace(
    CONFIG, reconstruction=ReconstructionConfig(sparsity=4, min_support=0.0), samples_per_pixel=4
)
STILL = replace(CONFIG, reflective_shadow_map=ReflectiveShadowMapConfig())
DOWN, ASIDE = (0.3, -1.0, 0.2), (1.0, 0.0, 0.0)

CASES = {
    "azimuths of the cones": Case("spot", "azimuths", replace(CONFIG, samples_per_pixel=16)),
    "sparse pixels, normal angle": Case("spot", "sparse_normal_angle", SPARSE),
    "sparse pixels, plane slope": Case("spot", "sparse_plane_slope", SPARSE),
    "sparse pixels, depth ratio": Case("spot", "sparse_depth_ratio", SPARSE),
    "sparse pixels that find too few neighbours, normal angle": Case(
        "spot",
        "sparse_normal_angle",
        replace(SPARSE, reconstruction=ReconstructionConfig(sparsity=4)),
        is_biased=True,
    ),
    "pre-filter of 3 voxels, scale": Case(
        "spot", "prefilter_scale", replace(STILL, injection=LightInjectionConfig(prefilter=3))
    ),
    "pre-filter of 5 voxels, scale": Case(
        "spot", "prefilter_scale", replace(STILL, injection=LightInjectionConfig(prefilter=5))
    ),
    "range of ambient occlusion": Case(
        "spot", "ambient_range_scale", replace(CONFIG, mode="ambient"), has_box=True
    ),
    "textured albedo of the walls": Case("spot", "reflectance.data", STILL),
    "textured roughness of a ball": Case("spot", "alpha.data", replace(STILL, samples_per_pixel=4)),
    "intensity of a spot": Case("spot", "intensity.value", STILL),
    "thickness, ambient occlusion": Case(
        "spot", "thickness_voxels", replace(CONFIG, mode="ambient"), has_box=True
    ),
    "thickness": Case("spot", "thickness_voxels", is_biased=True),
    "point light": Case("point", "position", way=DOWN),
    "spot": Case("spot", "to_world", way=DOWN),
    "sun that turns": Case("sun", "to_world", is_biased=True),
    "rectangular lamp": Case("lamp", "to_world", way=DOWN),
    "point light, with the shadow of a box": Case(
        "point", "position", way=ASIDE, has_box=True, is_biased=True
    ),
    "vertices of the room, scaled": Case("spot", "vertex_positions"),
    "vertices of a box, with its shadow and outline": Case(
        "spot", "vertex_positions", way=ASIDE, has_box=True, is_biased=True
    ),
}
"""What is measured."""

SCALED = ("reflectance.data", "alpha.data", "intensity.value")
"""Parameters of the scene in which pictures are smooth: numbers that a factor scales."""

QUICK = ("pre-filter of 3 voxels, scale", "spot")


def checks() -> list[Check]:
    """Return the checks of parameters that fill voxels, move, or interpolate."""
    found = []
    for name, case in CASES.items():
        against = (
            f"differences of step {_step(case):g}"
            if _is_fine(case)
            else f"differences over {2 * REACH:g}"
        )
        kind = "known bias, no limit" if case.is_biased else f"worst of {len(POINTS)} points"
        found += [
            Check(
                name=f"{name}, {mode} mode, off {against}",
                configuration=f"{kind}, analytic coverage, {case.config.clipmap.resolution}^3",
                scene=SCENE + (" and a box" if case.has_box else ""),
                measure=partial(_off, name=name, mode=mode),
                limit_high=None if case.is_biased else LIMIT,
                goal=0.0 if case.is_biased else 0.02,
                in_quick=name in QUICK,
            )
            for mode in MODES
        ]
    return found


def _is_live(case: Case) -> bool:
    """Whether the parameter is one of the renderer."""
    return case.name in ConeParameters.from_config(case.config)


def _is_fine(case: Case) -> bool:
    """Whether differences of small steps are those of the trend."""
    return _is_live(case) or case.name in SCALED


def _step(case: Case) -> float:
    """Return half the interval of the differences."""
    if _is_live(case):
        return STEP
    return SCALE_STEP if case.name in SCALED else REACH


def _off(context: StudyContext, name: str, mode: str) -> Measured:
    case = CASES[name]
    factors = (1.0,) if context.quick else POINTS
    picture, start = context.once(f"derivatives, placed, {name}", partial(make_picture, case))
    worst = 0.0
    for number, factor in enumerate(factors):
        context.progress(f"{name}, {mode}", number / len(factors))
        at = type(start)(start * factor)
        mean = context.once(
            f"derivatives, placed, mean, {name}, {factor}",
            partial(mean_picture, picture, moved(at, 0.0)),
        )
        wanted = context.once(
            f"derivatives, placed, differences, {name}, {factor}",
            partial(by_differences, picture, at, _step(case)),
        )
        found = _mean_derivative(picture, at, mode, is_single=_is_fine(case))
        off = disagreement(np.array([found]), np.array([wanted]), np.array([mean]))
        worst = max(worst, off.value)
    # What has derivatives here would be found by calls of emitters and BSDFs in other scenes
    mean_picture(picture, moved(start, 0.0))
    return Measured(value=worst)


def _mean_derivative(picture: Picture, start: Any, mode: str, *, is_single: bool) -> float:
    """Return the derivative by a share of the value, at it or as the mean over the interval."""
    if is_single:
        return MODES[mode](picture, start)
    total = 0.0
    for place, weight in GAUSS:
        factor = 1.0 + REACH * place
        # By a share of what the value is in the middle
        total += weight / factor * MODES[mode](picture, type(start)(start * factor))
    return total


def make_picture(case: Case) -> tuple[Picture, Any]:
    """Return the picture's numbers as a function of a parameter, and where the parameter is."""
    scene = mi.load_dict(_description(case))
    if not _is_live(case):
        return _scene_picture(case, scene), mi.Float(1.0)
    prepared = prepare_scene(scene, scene.sensors()[0], case.config)
    start = ConeParameters.from_config(case.config)[case.name]

    def picture(values: Any) -> mi.Float:
        parameters = ConeParameters.from_config(case.config)
        parameters[case.name] = values
        volume = light_volume(prepared, case.config, parameters=parameters).volume
        return _numbers(render_frame(prepared, volume, case.config, parameters=parameters))

    return picture, start


def _scene_picture(case: Case, scene: mi.Scene) -> Picture:
    """Return the picture as a function of 1 + how far the parameter is moved, or of a scale."""
    parameters: Any = mi.traverse(scene)
    owner = "bulb."
    if case.name in ("vertex_positions", "reflectance.data", "alpha.data"):
        owner = "box." if case.has_box else ""
    names = list(parameters.keys())
    (key,) = (k for k in names if k.startswith(owner) and k.endswith(case.name))
    held = type(parameters[key])(parameters[key])

    def picture(value: mi.Float) -> mi.Float:
        parameters[key] = _placed(case, held, value)
        parameters.update()
        prepared = prepare_scene(scene, scene.sensors()[0], case.config)
        volume = light_volume(prepared, case.config).volume
        return _numbers(render_frame(prepared, volume, case.config))

    return picture


def _placed(case: Case, held: Any, value: mi.Float) -> Any:
    """Return the parameter where it is moved to: by `value` - 1, in radians where it turns."""
    if case.name in SCALED:
        if dr.is_tensor_v(held):
            return type(held)(held.array * value, held.shape)
        return type(held)(held * value)
    if case.way is None:
        if case.name == "vertex_positions":
            return mi.Float(held * value)
        turn = mi.Transform4f().rotate(mi.Point3f(1.0, 0.0, 0.0), (value - 1.0) * DEGREES)
        return turn @ held
    offset = mi.Vector3f(*(axis * (value - 1.0) for axis in case.way))
    if case.name == "vertex_positions":
        return dr.ravel(dr.unravel(mi.Vector3f, held) + offset)
    if case.name == "position":
        return mi.Point3f(mi.Vector3f(held) + offset)
    return mi.Transform4f().translate(offset) @ held


DEGREES = math.degrees(1.0)


def _numbers(frame: Any) -> mi.Float:
    if frame.ambient is not None:
        return mi.Float(frame.ambient.array)
    return mi.Float(frame.indirect_diffuse.array + frame.indirect_specular.array)


def _turned() -> Any:
    axis = np.array([1.0, 2.0, 3.0])
    return mi.ScalarTransform4f().rotate((axis / np.linalg.norm(axis)).tolist(), 33.0)


def _lamps() -> dict[str, Callable[[], dict[str, Any]]]:
    """Lights by name."""
    place = mi.ScalarTransform4f()
    aim = place.look_at([0.3, 0.2, 0.3], [-0.2, -0.5, -0.4], [0, 1, 0])
    # Out of the camera's sight: outlines are not followed.
    flat = place.translate([0.1, 0.7, 0.0]) @ _turned() @ place.rotate([1, 0, 0], 90).scale(0.2)
    return {
        "point": lambda: {"type": "point", "position": [0.3, 0.1, 0.3], "intensity": 2.0},
        "spot": lambda: {
            "type": "spot",
            "to_world": aim,
            "intensity": 2.0,
            "cutoff_angle": 50.0,
            "beam_width": 20.0,
        },
        "sun": lambda: {"type": "directional", "direction": [0.3, -1.0, -0.5], "irradiance": 2.0},
        "lamp": lambda: {
            "type": "rectangle",
            "to_world": flat,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 5.0}},
        },
    }


def _bitmap(least: float, most: float, channels: int) -> dict[str, Any]:
    """Return a texture of random numbers between two."""
    drawn = np.random.default_rng(0).uniform(least, most, (4, 4, channels)).astype(np.float32)
    return {"type": "bitmap", "data": mi.TensorXf(drawn), "raw": True}


WALLS = ((0, 0.0), (1, 90.0), (1, 180.0), (1, 270.0), (0, 90.0), (0, -90.0))
"""Axis and angle of the turns that take a wall at z = -1 to all six."""


def _description(case: Case) -> dict[str, Any]:
    """Return the room; a sun shines through three walls that are left out."""
    place = mi.ScalarTransform4f()
    paint = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
    if case.name == "reflectance.data":
        paint["reflectance"] = _bitmap(0.2, 0.8, 3)
    found: dict[str, Any] = {"type": "scene", "bulb": _lamps()[case.lamp]()}
    for number, (axis, degrees) in enumerate(WALLS):
        if case.lamp == "sun" and number in (0, 2, 4):
            continue
        turn = place.rotate(np.eye(3)[axis].tolist(), degrees).translate([0, 0, -1])
        found[f"wall{number}"] = {"type": "rectangle", "to_world": _turned() @ turn, "bsdf": paint}
    if case.name.startswith("sparse"):
        # Neighbours on a ball are alike by degrees.
        found["ball"] = {
            "type": "sphere",
            "center": [-0.2, -0.3, -0.4],
            "radius": 0.6,
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.6}},
        }
    elif case.name == "alpha.data":
        # Too smooth to be split into cones that its surface hides one by one
        found["ball"] = {
            "type": "sphere",
            "center": [-0.2, -0.3, -0.4],
            "radius": 0.6,
            "bsdf": {"type": "roughconductor", "alpha": _bitmap(0.03, 0.07, 1)},
        }
    elif case.has_box:
        found["box"] = {
            "type": "cube",
            "to_world": place.translate([0.1, -0.5, -0.2]) @ _turned() @ place.scale(0.25),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.6}},
        }
    found["eye"] = {
        "type": "perspective",
        "fov": 70.0,
        "to_world": place.look_at([0.1, 0.2, 0.7], [-0.2, -0.3, -0.4], [0, 1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": 24,
            "height": 24,
            "rfilter": {"type": "box"},
            "component_format": "float32",
        },
    }
    return found
