"""Derivatives by where lights and vertices are, and by numbers that voxels are filled with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import area_light, camera, diffuse, load, oblique, room
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.light_injection import LightInjectionConfig
from vctgi.stages.reconstruction.config import ReconstructionConfig
from vctgi.stages.reflective_shadow_map.config import ReflectiveShadowMapConfig
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig

pytestmark = pytest.mark.usefixtures("variant")

CONFIG = RenderConfig(
    clipmap=ClipmapConfig(
        resolution=32, finest_voxel_size=0.12, centre=(0.0, 0.0, 0.0), level_count=1
    ),
    diffuse=DiffuseConesConfig(cone_count=6),
    samples_per_pixel=1,
    reflective_shadow_map=ReflectiveShadowMapConfig(texels_per_voxel=32.0, texels_per_face=1024.0),
    voxelization=OpacityVoxelizationConfig(coverage="analytic"),
)

LIMIT = 0.05
"""What the study asks of every derivative."""

MODES_AGREE = 1e-3
"""Both modes sum the same numbers in single precision, in another order."""

SLOW = pytest.mark.slow

Picture = Callable[["mi.Float"], "mi.Float"]


BEAM = {"cutoff_angle": 50.0, "beam_width": 20.0}


def lit_room(lamp: str = "spot", **more: Any) -> mi.Scene:
    """Return a turned room without shadows, so that nothing comes into sight or leaves it."""
    aim = mi.ScalarTransform4f().look_at([0.3, 0.2, 0.3], [-0.2, -0.5, -0.4], [0, 1, 0])
    # Out of the camera's sight: outlines are not followed.
    above = mi.ScalarTransform4f().translate([0.1, 0.7, 0.0]) @ oblique()
    lamps = {
        "spot": {"type": "spot", "to_world": aim, "intensity": 2.0, **BEAM},
        "point": {"type": "point", "position": [0.3, 0.1, 0.3], "intensity": 2.0},
        "lamp": {
            "type": "rectangle",
            "to_world": above @ mi.ScalarTransform4f().rotate([1, 0, 0], 90).scale(0.2),
            "emitter": area_light(5.0),
        },
    }
    eye = camera([0.1, 0.2, 0.7], [-0.2, -0.3, -0.4], size=12, fov=70.0)
    return load(**room(oblique()), bulb=lamps[lamp], eye=eye, **more)


def numbers_of(frame: Any) -> mi.Float:
    return mi.Float(frame.indirect_diffuse.array if frame.ambient is None else frame.ambient.array)


def by_parameter(scene: mi.Scene, config: RenderConfig, name: str) -> Picture:
    prepared = prepare_scene(scene, scene.sensors()[0], config)

    def picture(value: mi.Float) -> mi.Float:
        parameters = ConeParameters.from_config(config)
        parameters[name] = value
        volume = light_volume(prepared, config, parameters=parameters).volume
        return numbers_of(render_frame(prepared, volume, config, parameters=parameters))

    return picture


def by_place(
    scene: mi.Scene, config: RenderConfig, key: str, place: Callable[[Any, mi.Float], Any]
) -> Picture:
    parameters: Any = mi.traverse(scene)
    held = type(parameters[key])(parameters[key])

    def picture(value: mi.Float) -> mi.Float:
        parameters[key] = place(held, value)
        parameters.update()
        prepared = prepare_scene(scene, scene.sensors()[0], config)
        return numbers_of(render_frame(prepared, light_volume(prepared, config).volume, config))

    return picture


def vertices_of(parameters: Any) -> str:
    """Return the name of the vertices of the room, which is one merged mesh."""
    (key,) = (name for name in list(parameters.keys()) if name.endswith("vertex_positions"))
    return str(key)


def mean_of(picture: Picture, value: float) -> float:
    return float(np.mean(np.array(picture(dr.opaque(mi.Float, value)), dtype=np.float64)))


def difference(picture: Picture, at: float, step: float) -> float:
    return (mean_of(picture, at + step) - mean_of(picture, at - step)) / (2.0 * step)


def both_modes(picture: Picture, at: float) -> float:
    """Return the derivative of the mean in reverse mode, which forward mode must agree with."""
    value = dr.opaque(mi.Float, at)
    dr.enable_grad(value)
    numbers = picture(value)
    dr.backward(numbers * (1.0 / dr.width(numbers)))
    reverse = float(dr.grad(value)[0])
    value = dr.opaque(mi.Float, at)
    dr.enable_grad(value)
    dr.set_grad(value, 1.0)
    slope = dr.forward_to(picture(value), flags=dr.ADFlag.ClearEdges)
    forward = float(np.mean(np.array(slope, dtype=np.float64)))
    rounding = 1e-5 * float(np.mean(np.array(dr.detach(numbers), dtype=np.float64)))
    assert reverse == pytest.approx(forward, rel=MODES_AGREE, abs=rounding)
    return reverse


def moved_down(held: Any, value: mi.Float) -> Any:
    """Move a transform or a point by a distance."""
    offset = mi.Vector3f(0.3 * value, -value, 0.2 * value)
    if isinstance(held, mi.Point3f):
        return mi.Point3f(mi.Vector3f(held) + offset)
    return mi.Transform4f().translate(offset) @ held


@pytest.mark.parametrize("width", [3, 5])
def test_the_scale_of_the_pre_filter_has_its_derivative(width: int) -> None:
    config = replace(
        CONFIG,
        injection=LightInjectionConfig(prefilter=width),
        reflective_shadow_map=ReflectiveShadowMapConfig(),
    )
    picture = by_parameter(lit_room(), config, "prefilter_scale")
    assert both_modes(picture, 1.0) == pytest.approx(difference(picture, 1.0, 1e-3), rel=LIMIT)


def test_openness_has_its_derivative_by_thickness() -> None:
    """Without light there are no texels that fill voxels in jumps."""
    config = replace(CONFIG, mode="ambient")
    picture = by_parameter(lit_room(), config, "thickness_voxels")
    assert both_modes(picture, 1.1) == pytest.approx(difference(picture, 1.1, 1e-3), rel=LIMIT)


@SLOW
def test_light_has_its_derivative_by_thickness() -> None:
    picture = by_parameter(lit_room(), CONFIG, "thickness_voxels")
    # Texels fill layers in jumps, which a longer step averages over.
    wanted = difference(picture, 1.3, 0.05)
    floor = 0.02 * mean_of(picture, 1.3)
    assert abs(both_modes(picture, 1.3) - wanted) < LIMIT * max(abs(wanted), floor)


ENDS = (0.995, 1.005)
"""Factors on a width between which its derivative is compared."""


@pytest.mark.parametrize(
    "name",
    ["plane_slope", *(pytest.param(n, marks=SLOW) for n in ("normal_angle", "depth_ratio"))],
)
def test_widths_of_the_interpolation_have_their_derivatives(name: str) -> None:
    ball = {"type": "sphere", "center": [-0.2, -0.3, -0.4], "radius": 0.6, "bsdf": diffuse(0.6)}
    sparse = ReconstructionConfig(sparsity=4, min_support=0.0)
    config = replace(CONFIG, reconstruction=sparse)
    at = getattr(config.reconstruction, f"max_{name}")
    picture = by_parameter(lit_room(ball=ball), config, f"sparse_{name}")
    # Pixel by pixel: some get brighter and others darker, and the mean hardly changes.
    ends = [np.array(picture(dr.opaque(mi.Float, at * f)), dtype=np.float64) for f in ENDS]
    wanted = (ends[1] - ends[0]) / (at * (ENDS[1] - ENDS[0]))
    value = dr.opaque(mi.Float, at)
    dr.enable_grad(value)
    dr.set_grad(value, 1.0)
    found = np.array(dr.forward_to(picture(value), flags=dr.ADFlag.ClearEdges), dtype=np.float64)
    assert np.linalg.norm(wanted) > 0.0
    assert np.linalg.norm(found - wanted) < LIMIT * np.linalg.norm(wanted)
    both_modes(picture, at)


CASES = {
    "spot": ("spot", "bulb.to_world"),
    "point": ("point", "bulb.position"),
    "rectangle": ("lamp", "bulb.to_world"),
}


@pytest.mark.parametrize(
    "case",
    [name if name == "spot" else pytest.param(name, marks=SLOW) for name in CASES],
)
def test_a_light_that_moves_without_shadows_has_its_derivative(case: str) -> None:
    lamp, key = CASES[case]
    picture = by_place(lit_room(lamp), CONFIG, key, moved_down)
    # Its texels pass from voxel to voxel in jumps, so steps must be long; the trend is straight.
    wanted = difference(picture, 0.0, 0.05)
    floor = 0.02 * mean_of(picture, 0.0)
    assert abs(both_modes(picture, 0.0) - wanted) < LIMIT * max(abs(wanted), floor)


BIAS_OF_COVERAGE = 0.15
"""What a surface newly covers is lit as the slot is on average, not as it is at its rim: the larger
the voxel and the steeper the light, the more it is off."""


def test_a_room_that_grows_has_its_derivative() -> None:
    """Coverage, irradiance and what the camera sees by vertices, in both modes.

    Dr.Jit loses a part of it in reverse mode if coverage and hit points read the same buffer.
    """
    scene = lit_room()
    key = vertices_of(mi.traverse(scene))
    picture = by_place(scene, CONFIG, key, lambda held, value: mi.Float(held * value))
    wanted = difference(picture, 1.0, 0.03)
    assert both_modes(picture, 1.0) == pytest.approx(wanted, rel=BIAS_OF_COVERAGE)


def test_vertices_are_refused_where_coverage_is_no_smooth_function_of_them() -> None:
    scene = lit_room()
    parameters: Any = mi.traverse(scene)
    key = vertices_of(parameters)
    dr.enable_grad(parameters[key])
    parameters.update()
    cells = replace(CONFIG, voxelization=OpacityVoxelizationConfig())
    bounces = replace(CONFIG, scattering_count=3)
    for config in (cells, bounces):
        with pytest.raises(SceneError, match="no derivative"):
            prepare_scene(scene, scene.sensors()[0], config)
    live = ConeParameters.from_config(CONFIG)
    dr.enable_grad(live["thickness_voxels"])
    assert "thickness_voxels" not in ConeParameters.from_config(cells)


RATE = 0.06
"""First step of Adam, world units; each is a fifth shorter than the last."""


@SLOW
def test_mitsuba_finds_the_place_of_a_light_again() -> None:
    """Through `mi.render`, `dr.backward` and Adam, direct light and one bounce together."""
    scene = lit_room("point")
    integrator = mi.load_dict({"type": "vctgi", "resolution": 16, "cone_count": 6})
    parameters: Any = mi.traverse(scene)
    key = "bulb.position"
    render: Any = mi.render
    true = mi.Point3f(parameters[key])
    target = dr.detach(render(scene, integrator=integrator, spp=4, seed=1))[..., :3]
    optimiser: Any = mi.ad.Adam(lr=RATE)  # type: ignore[attr-defined]
    optimiser[key] = mi.Point3f(mi.Vector3f(true) + mi.Vector3f(-0.2, 0.1, -0.15))
    distances = []
    for step in range(10):
        parameters.update(optimiser)
        image = render(scene, parameters, integrator=integrator, spp=4, seed=step + 2)[..., :3]
        dr.backward(dr.mean(dr.square(image - target)))
        optimiser.step()
        optimiser.set_learning_rate(RATE * 0.8 ** (step + 1))
        distances.append(float(dr.norm(optimiser[key] - true)[0]))
    assert distances[-1] < 0.25 * distances[0]
