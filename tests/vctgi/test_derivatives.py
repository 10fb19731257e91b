"""Derivatives of whole pictures: parameters of the scene, those that are refused, and mi.render."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import area_light, camera, diffuse, load, room
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.scene.derivatives import has_derivatives, moving_names
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.light_injection import LightInjectionConfig

pytestmark = pytest.mark.usefixtures("variant")

CONFIG = RenderConfig(
    clipmap=ClipmapConfig(resolution=16),
    diffuse=DiffuseConesConfig(cone_count=4, near_field_voxels=2.0),
    bounce_cones=DiffuseConesConfig(cone_count=4),
    samples_per_pixel=1,
)

POLYNOMIAL = 2e-3
"""Pictures are polynomials of low degree in albedo and light: differences of a step of 0.01 are
exact but for the cubic term and rounding."""

LAMP = "lamp.emitter.radiance.value"
WALL = "paint.reflectance.value"


def lit_room() -> mi.Scene:
    lamp = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0.6, 0]).rotate([1, 0, 0], 90).scale(0.3),
        "emitter": area_light(5.0),
    }
    paint = {**diffuse(), "id": "paint"}
    walls = room(bsdf={"type": "ref", "id": "paint"})
    bulb = {"type": "point", "position": [0.3, 0.0, 0.3], "intensity": 2.0}
    eye = camera([0, 0, 0.9], [0, -0.3, 0], size=8, fov=80.0)
    return load(paint=paint, **walls, lamp=lamp, bulb=bulb, eye=eye)


def picture(scene: mi.Scene, config: RenderConfig) -> mi.Float:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    return mi.Float(
        render_frame(prepared, light_volume(prepared, config).volume, config).indirect_diffuse.array
    )


def mean_at(scene: mi.Scene, config: RenderConfig, name: str, value: Any) -> float:
    parameters: Any = mi.traverse(scene)
    parameters[name] = value
    parameters.update()
    return float(np.mean(np.array(picture(scene, config), dtype=np.float64)))


CASES = {
    "light, one bounce": (LAMP, CONFIG),
    "point light": ("bulb.intensity.value", CONFIG),
    "albedo, one bounce": (WALL, CONFIG),
    "albedo, three scatterings": (WALL, replace(CONFIG, scattering_count=3)),
    "albedo, spread light": (
        WALL,
        replace(CONFIG, injection=LightInjectionConfig(algorithm="gather", prefilter=3)),
    ),
    "light, bounded by radiance": (
        LAMP,
        replace(CONFIG, injection=LightInjectionConfig(normalisation="radiance")),
    ),
}


SLOW = ("light, bounded by radiance", "light, one bounce")
"""Cases of which others are most; their kernels take long to compile."""


@pytest.mark.parametrize(
    "case",
    [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in CASES],
)
def test_both_modes_are_the_central_difference(case: str) -> None:
    name, config = CASES[case]
    scene = lit_room()
    parameters: Any = mi.traverse(scene)
    start = type(parameters[name])(parameters[name])
    step = 1e-2 * float(np.array(start).ravel()[0])
    ends = [mean_at(scene, config, name, start + sign * step) for sign in (1.0, -1.0)]
    wanted = (ends[0] - ends[1]) / (2.0 * step)
    assert wanted > 0.0

    value = type(start)(start)
    dr.enable_grad(value)
    parameters[name] = value
    parameters.update()
    numbers = picture(scene, config)
    dr.set_grad(value, 1.0)
    slope = dr.forward_to(numbers, flags=dr.ADFlag.ClearInterior)
    forward = float(np.mean(np.array(slope, dtype=np.float64)))
    dr.set_grad(value, 0.0)
    dr.clear_grad(numbers)
    numbers = picture(scene, config)
    dr.backward(numbers * (1.0 / dr.width(numbers)))
    backward = float(np.sum(np.array(dr.grad(value), dtype=np.float64)))
    assert forward == pytest.approx(wanted, rel=POLYNOMIAL)
    assert backward == pytest.approx(wanted, rel=POLYNOMIAL)


def test_parameters_without_a_derivative_are_refused() -> None:
    """All that Mitsuba calls differentiable either has its derivative or says that it has none."""
    scene = lit_room()
    parameters: Any = mi.traverse(scene)
    supported, refused = set(), set()
    moving = moving_names(scene, can_shapes_move=False)
    for name in list(parameters.keys()):
        value = parameters[name]
        dr.enable_grad(value)
        if not dr.grad_enabled(value):
            continue
        if has_derivatives(name) or name in moving:
            supported.add(name)
        else:
            refused.add(name.partition(".")[2])
            with pytest.raises(SceneError, match="no derivative"):
                prepare_scene(scene, scene.sensors()[0], CONFIG)
        dr.disable_grad(value)
    assert {LAMP, WALL, "bulb.intensity.value", "bulb.position"} <= supported
    assert {"vertex_positions", "to_world"} <= refused


@pytest.mark.parametrize(
    "config",
    [
        replace(CONFIG, emission_in_voxels=True),
        replace(CONFIG, sky_in_cones=True),
        replace(CONFIG, sky_lighting="cones"),
    ],
)
def test_light_on_ways_without_a_derivative_is_refused(config: RenderConfig) -> None:
    scene = lit_room()
    parameters: Any = mi.traverse(scene)
    dr.enable_grad(parameters[LAMP])
    with pytest.raises(SceneError, match="no derivative: the parameter 'lamp"):
        prepare_scene(scene, scene.sensors()[0], config)


def test_mitsuba_renders_with_derivatives() -> None:
    """`mi.render` with other random numbers for the derivative than for the picture."""
    scene = lit_room()
    integrator = mi.load_dict({"type": "vctgi", "preset": "medium", "resolution": 16})
    parameters = mi.traverse(integrator)
    name = "opacity_exponent"
    parameters[name] = dr.opaque(mi.Float, 1.0)
    parameters.update()
    dr.enable_grad(parameters[name])
    render: Any = mi.render
    image = render(scene, parameters, integrator=integrator, spp=2, seed=1, seed_grad=2)
    dr.backward(dr.mean(image[..., :3]))
    found = float(dr.grad(parameters[name])[0])
    ends = []
    for value in (1.01, 0.99):
        parameters[name] = dr.opaque(mi.Float, value)
        parameters.update()
        image = render(scene, integrator=integrator, spp=2, seed=2)[..., :3]
        ends.append(float(np.mean(np.array(image, dtype=np.float64))))
    assert found == pytest.approx((ends[0] - ends[1]) / 0.02, rel=1e-2)


def test_adam_finds_a_value_again() -> None:
    scene = lit_room()
    prepared = prepare_scene(scene, scene.sensors()[0], CONFIG)
    volume = light_volume(prepared, CONFIG).volume

    def image(scale: mi.Float) -> mi.Float:
        parameters = ConeParameters.from_config(CONFIG)
        parameters["opacity_exponent"] = scale
        return mi.Float(
            render_frame(prepared, volume, CONFIG, parameters=parameters).indirect_diffuse.array
        )

    target = dr.detach(image(dr.opaque(mi.Float, 1.4)))
    optimiser = mi.ad.Adam(lr=0.05)  # type: ignore[attr-defined]
    optimiser["scale"] = mi.Float(1.0)
    losses = []
    for _ in range(12):
        loss = dr.mean(dr.square(image(optimiser["scale"]) - target))
        dr.backward(loss)
        optimiser.step()
        losses.append(float(loss[0]))
    assert losses[-1] < 0.1 * losses[0]
    assert float(optimiser["scale"][0]) == pytest.approx(1.4, abs=0.1)


def test_ambient_occlusion_has_a_derivative_by_its_range() -> None:
    scene = lit_room()
    config = replace(CONFIG, mode="ambient")
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume

    def openness(scale: mi.Float) -> mi.Float:
        parameters = ConeParameters.from_config(config)
        parameters["ambient_range_scale"] = scale
        frame = render_frame(prepared, volume, config, parameters=parameters)
        assert frame.ambient is not None
        return mi.Float(frame.ambient.array)

    ends = [np.mean(np.array(openness(dr.opaque(mi.Float, v)), np.float64)) for v in (1.01, 0.99)]
    scale = dr.opaque(mi.Float, 1.0)
    dr.enable_grad(scale)
    dr.backward(dr.mean(openness(scale)))
    assert ends[0] < ends[1]
    assert float(dr.grad(scale)[0]) == pytest.approx((ends[0] - ends[1]) / 0.02, rel=POLYNOMIAL)
