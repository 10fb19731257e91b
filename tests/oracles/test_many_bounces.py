"""Oracle 5 for many scatterings: the furnace's geometric sum, linearity, symmetry, contraction."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import stored_numbers
from tests.vctgi.small_scenes import area_light, camera, diffuse, load, oblique, room
from vctgi.config import RenderConfig, preset
from vctgi.pipeline import LitVolume, light_volume, prepare_scene, render_frame
from vctgi.stages.bounces import BouncesConfig

pytestmark = pytest.mark.usefixtures("variant")

EMISSION = 2.0

LEAST_RATIO, MOST_RATIO = 0.92, 1.001
"""Light that a scattering keeps of what the closed box has: wide cones lose some."""

SPREAD = 0.02
"""Relative: every scattering loses the same share."""


def furnace(albedo: float, is_turned: bool = False, emission: float = EMISSION) -> mi.Scene:
    outer: Any = oblique() if is_turned else mi.ScalarTransform4f()
    walls = room(outer, bsdf=diffuse(albedo), emitter=area_light(emission))
    eye = camera([0.6, 0.5, 0.7], [0.0, 0.0, 0.0], size=8, fov=90.0, outer=outer)
    return load(sensor=eye, **walls)


def settings(scattering_count: int) -> RenderConfig:
    config = preset("high")
    return replace(
        config,
        clipmap=replace(config.clipmap, resolution=32),
        scattering_count=scattering_count,
        bounces=BouncesConfig(min_bounce_share=0.0),
        samples_per_pixel=1,
    )


def lit(scene: mi.Scene, config: RenderConfig) -> LitVolume:
    return light_volume(prepare_scene(scene, scene.sensors()[0], config), config)


@pytest.mark.parametrize("is_turned", [False, True], ids=["axis", "turned"])
@pytest.mark.parametrize("albedo", [0.2, 0.8])
def test_each_scattering_keeps_the_same_share(albedo: float, is_turned: bool) -> None:
    fluxes = np.array(lit(furnace(albedo, is_turned), settings(9)).bounce_fluxes)
    assert len(fluxes) == 8
    ratios = fluxes[1:] / fluxes[:-1] / albedo
    assert ratios.min() >= LEAST_RATIO
    assert ratios.max() <= MOST_RATIO
    assert ratios.max() / ratios.min() <= 1.0 + SPREAD


@pytest.mark.parametrize("count", [3, 5])
def test_picture_is_the_closed_form_of_many_scatterings(count: int) -> None:
    albedo = 0.5
    scene, config = furnace(albedo), settings(count)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    # Of e (1 - a^(k+1)) / (1 - a) the first two terms are emission and direct light.
    exact = EMISSION * (1.0 - albedo ** (count + 1)) / (1.0 - albedo) - EMISSION * (1.0 + albedo)
    share = float(np.array(frame.indirect_diffuse).mean()) / exact
    assert LEAST_RATIO ** (count - 1) <= share <= MOST_RATIO


def test_light_of_two_scatterings_is_that_without_bounces() -> None:
    scene = furnace(0.5)
    plain = replace(settings(2), bounces=BouncesConfig())
    volumes = [lit(scene, each).volume for each in (settings(2), plain)]
    np.testing.assert_array_equal(stored_numbers(volumes[0]), stored_numbers(volumes[1]))
    assert lit(scene, plain).bounce_fluxes == []


def test_bounced_light_is_linear() -> None:
    once, thrice = (
        np.array(lit(furnace(0.5, emission=each), settings(5)).bounce_fluxes) for each in (1.0, 3.0)
    )
    np.testing.assert_allclose(thrice, 3.0 * once, rtol=1e-5)


def test_black_walls_send_nothing_on() -> None:
    assert lit(furnace(0.0), settings(9)).bounce_fluxes == [0.0]


@pytest.mark.slow
@pytest.mark.parametrize("albedo", [0.95, 0.99])
def test_bounces_contract(albedo: float) -> None:
    # A positive operator: successive fluxes approach its spectral radius.
    fluxes = lit(furnace(albedo), settings(20)).bounce_fluxes
    assert fluxes[-1] / fluxes[-2] < albedo * MOST_RATIO < 1.0


def test_a_symmetric_room_is_lit_alike_on_both_sides() -> None:
    # A lamp in the middle of the ceiling: the walls at -x and +x are mirror images.
    lamp = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0.9, 0]).rotate([1, 0, 0], 90).scale(0.3),
        "emitter": area_light(5.0),
        "bsdf": diffuse(0.0),
    }
    config = settings(4)
    means = []
    for side in (-1.0, 1.0):
        eye = camera([0.0, 0.0, 0.01], [side, 0.0, 0.01], size=12, fov=60.0)
        scene = load(sensor=eye, lamp=lamp, **room(bsdf=diffuse(0.7)))
        config = replace(config, clipmap=replace(config.clipmap, centre=(0.0, 0.0, 0.0)))
        prepared = prepare_scene(scene, scene.sensors()[0], config)
        frame = render_frame(prepared, light_volume(prepared, config).volume, config)
        means.append(float(np.array(frame.indirect_diffuse).mean()))
    assert means[0] == pytest.approx(means[1], rel=0.02)
