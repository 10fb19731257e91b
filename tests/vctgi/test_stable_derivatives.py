"""Derivatives at the ends of what parameters can be: finite and of the right sign, or refused."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of
from tests.vctgi.small_scenes import area_light, camera, diffuse, load, room
from vctgi.clipmap.levels import ClipmapConfig, lay_out_clipmap
from vctgi.clipmap.storage import VoxelVolume, pack_volume
from vctgi.config import RenderConfig
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.cone_tracing.live_march import LiveMarch
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone

pytestmark = pytest.mark.usefixtures("variant")

LAYOUT = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=1 / 8, level_count=1, resolution=8)
CONES = 32

CONFIG = RenderConfig(
    clipmap=ClipmapConfig(resolution=8),
    diffuse=DiffuseConesConfig(cone_count=4),
    bounce_cones=DiffuseConesConfig(cone_count=4),
    samples_per_pixel=1,
)

ALMOST = 1e-3
"""Single precision, of a sum over cones."""

LAMP = "lamp.emitter.radiance.value"
WALL = "paint.reflectance.value"


def filled(opacity: float, emittance: float) -> VoxelVolume:
    shapes = [(6,) + (level.resolution,) * 3 for level in LAYOUT.levels]
    alphas = [np.full(shape, opacity) for shape in shapes]
    colors = [np.repeat(emittance * a[..., None], 3, axis=-1) for a in alphas]
    return pack_volume(opacity_of(LAYOUT, alphas), emittance_of(LAYOUT, colors))


def cone_sums(volume: VoxelVolume, **numbers: mi.Float) -> tuple[mi.Float, mi.Float]:
    """Radiance and transmittance, summed over cones into all directions."""
    rules = ConeMarchConfig()
    ratio = numbers.pop("ratio", mi.Float(0.5))
    live = LiveMarch.of_numbers(rules, None)
    for name, value in numbers.items():
        setattr(live, name, value)
    d = np.random.default_rng(3).normal(size=(3, CONES))
    axis = mi.Vector3f(d / np.linalg.norm(d, axis=0))
    apex = mi.Point3f(0.02, 0.03, 0.04)
    found = march_cone(volume, apex, axis, ratio, mi.Float(0.6), live, mi.Bool(True))
    return mi.Float(dr.sum(found.radiance.x)), mi.Float(dr.sum(found.transmittance))


@pytest.mark.parametrize("emittance", [1e-8, 1.0, 1e8])
def test_voxels_close_to_opaque_let_less_through_and_show_more(emittance: float) -> None:
    """The exponent makes fog denser, up to where no single precision sees through it any more."""
    for opacity in (0.01, 0.5, 0.9, 0.9999, 1.0):
        factor = dr.opaque(mi.Float, 1.0)
        dr.enable_grad(factor)
        radiance, through = cone_sums(filled(opacity, emittance), correction_factor=factor)
        dr.backward(through)
        by_through = float(dr.grad(factor)[0])
        dr.set_grad(factor, 0.0)
        radiance, through = cone_sums(filled(opacity, emittance), correction_factor=factor)
        dr.backward(radiance)
        by_radiance = float(dr.grad(factor)[0]) / emittance
        assert np.isfinite([by_through, by_radiance]).all(), opacity
        # What is stopped shines: L = emittance (1 - T)
        assert by_through <= 0.0, opacity
        assert by_radiance == pytest.approx(-by_through, abs=ALMOST * CONES), opacity
        assert by_radiance >= -ALMOST * CONES, opacity


def test_shorter_steps_go_to_one_derivative() -> None:
    """Of fog, whose march is exact at any step: none by the step, one by the exponent."""
    found = []
    for shortest in (0.3, 0.03, 0.003):
        factor = dr.opaque(mi.Float, 1.0)
        small, ratio = dr.opaque(mi.Float, shortest), dr.opaque(mi.Float, 1e-6)
        values = [factor, small, ratio]
        dr.enable_grad(values)
        numbers = {"min_step_voxels": small, "step_ratio": ratio}
        _, through = cone_sums(filled(0.2, 1.0), correction_factor=factor, **numbers)
        dr.backward(through)
        slopes = [float(dr.grad(value)[0]) for value in values]
        assert np.isfinite(slopes).all()
        assert abs(slopes[1]) < ALMOST * CONES / shortest
        found.append(slopes[0])
    assert found[0] < 0.0
    np.testing.assert_allclose(found, found[0], rtol=1e-2)


def closed_room() -> mi.Scene:
    lamp = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0.6, 0]).rotate([1, 0, 0], 90).scale(0.3),
        "emitter": area_light(5.0),
    }
    walls = room(bsdf={"type": "ref", "id": "paint"})
    eye = camera([0, 0, 0.9], [0, -0.3, 0], size=4, fov=80.0)
    return load(paint={**diffuse(), "id": "paint"}, **walls, lamp=lamp, eye=eye)


def mean_and_slope(scene: mi.Scene, config: RenderConfig, name: str) -> tuple[float, float]:
    """Return the mean picture, and its derivative by the parameter's share."""
    parameters: Any = mi.traverse(scene)
    held = type(parameters[name])(parameters[name])
    share = dr.opaque(mi.Float, 0.0)
    dr.enable_grad(share)
    parameters[name] = held * (1.0 + share)
    parameters.update()
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    numbers = mi.Float(frame.indirect_diffuse.array)
    dr.backward(numbers * (1.0 / dr.width(numbers)))
    parameters[name] = held
    parameters.update()
    return float(np.mean(np.array(numbers, dtype=np.float64))), float(dr.grad(share)[0])


@pytest.mark.parametrize("radiance", [1e-8, 1e8])
def test_faint_and_bright_lamps_have_the_derivative_that_is_the_picture(radiance: float) -> None:
    """Light is linear: the derivative by the lamp's share is the picture itself."""
    scene = closed_room()
    parameters: Any = mi.traverse(scene)
    parameters[LAMP] = mi.Color3f(radiance)
    parameters.update()
    mean, slope = mean_and_slope(scene, CONFIG, LAMP)
    assert mean > 0.0
    assert slope == pytest.approx(mean, rel=ALMOST)


def test_white_walls_that_feed_light_back_have_a_finite_derivative() -> None:
    """Light of n scatterings goes with the n-th power of the albedo, here 2 <= n <= 6."""
    scene = closed_room()
    parameters: Any = mi.traverse(scene)
    parameters[WALL] = mi.Color3f(0.99)
    parameters.update()
    config = replace(CONFIG, scattering_count=6)
    mean, slope = mean_and_slope(scene, config, WALL)
    assert 2.0 * mean < slope < 6.0 * mean


def openings() -> tuple[Any, Any, ConeParameters]:
    scene = closed_room()
    prepared = prepare_scene(scene, scene.sensors()[0], CONFIG)
    return prepared, light_volume(prepared, CONFIG).volume, ConeParameters.from_config(CONFIG)


def test_cones_from_rays_to_half_spaces_have_finite_derivatives() -> None:
    prepared, volume, parameters = openings()
    for aperture in (0.0, 1e-7, 1e-3, 1.0, 3.0, math.pi - 1e-5):
        value = mi.Float([aperture] * CONFIG.diffuse.cone_count)
        dr.make_opaque(value)
        dr.enable_grad(value)
        parameters["apertures"] = value
        frame = render_frame(prepared, volume, CONFIG, parameters=parameters)
        numbers = mi.Float(frame.indirect_diffuse.array)
        dr.backward(dr.mean(numbers))
        assert np.isfinite(np.array(numbers)).all(), aperture
        assert np.isfinite(np.array(dr.grad(value))).all(), aperture


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("apertures", math.pi, "must be in"),
        ("apertures", -0.1, "must be in"),
        ("aperture_scale", 100.0, "none can be wider"),
        ("step_ratio", 0.0, "must be in"),
        ("min_step_voxels", 0.0, "must be in"),
        ("opacity_exponent", -1.0, "must be in"),
        ("weights", 0.0, "must be in"),
        ("level_bias", math.nan, "must be finite"),
        ("step_ratio", math.inf, "must be finite"),
    ],
)
def test_values_that_are_no_cones_are_refused(name: str, value: float, words: str) -> None:
    parameters = ConeParameters.from_config(CONFIG)
    parameters[name] = mi.Float([value] * dr.width(parameters[name]))
    with pytest.raises(ValueError, match=words):
        parameters.check_bounds()
