"""Sky: a constant environment gives E / pi = L times the share of it that is visible."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import camera, color, diffuse, load, room
from vctgi.config import RenderConfig, preset
from vctgi.pipeline import Frame, light_volume, prepare_scene, render_frame
from vctgi.scene.sky import SkyConfig, cone_directions, environment_radiance, prefilter_sky

pytestmark = pytest.mark.usefixtures("variant")

RADIANCE = (0.5, 1.0, 2.0)
ALBEDO = 0.6

ROUNDING = 1e-4

LEAK = 0.09
"""What wide cones let through the walls of a closed room, once from the walls to the sky and once
more to lit walls: measured 0.073, and 0.051 with voxels of half the size."""

RIM = 0.05
"""Share of a map's light that may fall beside the voxels of a floor's rim."""


def floor() -> dict[str, Any]:
    turn = mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale(4.0)
    return {"type": "rectangle", "to_world": turn, "bsdf": diffuse(ALBEDO)}


def sky() -> dict[str, Any]:
    return {"type": "constant", "radiance": color(*RADIANCE)}


def config_of(**changes: Any) -> RenderConfig:
    config = preset("high")
    clipmap = replace(config.clipmap, resolution=32)
    return replace(config, clipmap=clipmap, samples_per_pixel=1, **changes)


def render(config: RenderConfig, **parts: Any) -> Frame:
    eye = camera([0.0, 1.5, 1.5], [0.0, 0.0, 0.0], size=8, fov=30.0)
    scene = load(sensor=eye, **parts)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    return render_frame(prepared, light_volume(prepared, config).volume, config)


def test_an_open_floor_sees_the_whole_sky() -> None:
    frame = render(config_of(sky_in_cones=True), floor=floor(), sky=sky())
    found = np.array(frame.indirect_diffuse).reshape(-1, 3)
    np.testing.assert_allclose(found, np.tile(ALBEDO * np.array(RADIANCE), (64, 1)), rtol=ROUNDING)


def test_cones_see_no_sky_unless_asked() -> None:
    # The floor alone reflects nothing to itself; what the sky sends it is direct light.
    frame = render(config_of(), floor=floor(), sky=sky())
    assert not np.array(frame.indirect_diffuse).any()


def test_a_mirror_sees_the_sky_above() -> None:
    mirror = floor() | {"bsdf": {"type": "conductor", "material": "none"}}
    seen = render(config_of(sky_in_cones=True), floor=mirror, sky=sky())
    np.testing.assert_allclose(
        np.array(seen.indirect_specular).reshape(-1, 3), np.tile(RADIANCE, (64, 1)), rtol=0.01
    )
    unasked = render(config_of(), floor=mirror, sky=sky())
    assert not np.array(unasked.indirect_specular).any(), "it is direct light, Mitsuba's"


def test_a_closed_room_sees_hardly_any_sky() -> None:
    eye = camera([0.5, 0.5, 0.5], [0.0, 0.0, 0.0], size=8, fov=120.0)
    scene = load(sensor=eye, sky=sky(), **room(bsdf=diffuse(ALBEDO)))
    config = config_of(sky_in_cones=True, sky_lighting="cones")
    config = replace(config, clipmap=replace(config.clipmap, resolution=64))
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    assert np.array(frame.indirect_diffuse).mean() < LEAK * ALBEDO * np.mean(RADIANCE)


@pytest.mark.parametrize("lighting", ["maps", "cones"])
def test_the_sky_lights_voxels_once(lighting: str) -> None:
    # An open floor emits albedo x L, which a camera below nothing sees: ask the voxels' flux.
    eye = camera([0.0, 1.5, 1.5], [0.0, 0.0, 0.0], size=8, fov=30.0)
    scene = load(sensor=eye, floor=floor(), sky=sky())
    config = config_of(sky_lighting=lighting, scattering_count=3)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    assert len(prepared.plan.lights) == (lighting == "maps")
    flux = light_volume(prepared, config).bounce_fluxes[0]
    exact = math.pi * 8.0**2 * ALBEDO * np.mean(RADIANCE)
    assert flux == pytest.approx(exact, rel=RIM)


def test_averages_over_cones_are_those_of_the_emitter() -> None:
    picture = np.zeros((8, 16, 3), np.float32)
    picture[:4, :, :] = np.linspace(0.5, 2.0, 16)[None, :, None]
    environment = load(
        ball={"type": "sphere"}, sky={"type": "envmap", "bitmap": mi.Bitmap(picture)}
    ).environment()
    found = prefilter_sky(environment, SkyConfig(resolution=128, samples_per_edge=4))
    axes = np.random.default_rng(1).normal(size=(64, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    axis = mi.Vector3f(np.ascontiguousarray(axes.T, dtype=np.float32))
    for degrees in (5.0, 30.0, 75.0, 180.0):
        aperture = math.radians(degrees)
        exact = np.zeros((64, 3))
        frame = mi.Frame3f(axis)
        for local in cone_directions(aperture, 256):
            direction = frame.to_world(mi.Vector3f(*(dr.opaque(mi.Float, c) for c in local)))
            exact += np.array(environment_radiance(environment, direction)).T / 256
        read = np.array(found.read(axis, mi.Float(aperture))).T
        scale = exact.mean()
        assert np.sqrt(np.mean((read - exact) ** 2)) <= 0.05 * scale, degrees
        assert read.mean() == pytest.approx(exact.mean(), rel=0.01)


def test_a_constant_sky_is_the_same_for_every_cone() -> None:
    environment = load(ball={"type": "sphere"}, sky=sky()).environment()
    found = prefilter_sky(environment, SkyConfig(resolution=64, samples_per_edge=1))
    axes = mi.warp.square_to_uniform_sphere(
        mi.Point2f(dr.linspace(mi.Float, 0, 1, 100), dr.linspace(mi.Float, 0, 1, 100))
    )
    for aperture in (1e-3, 0.3, math.pi, 4.0):
        np.testing.assert_allclose(
            np.array(found.read(axes, mi.Float(aperture))).T,
            np.tile(RADIANCE, (100, 1)),
            rtol=ROUNDING,
        )


def test_a_sky_that_is_no_light_is_refused() -> None:
    picture = np.ones((8, 16, 3), np.float32)
    picture[2, 3] = np.inf
    environment = load(
        ball={"type": "sphere"}, sky={"type": "envmap", "bitmap": mi.Bitmap(picture)}
    ).environment()
    with pytest.raises(ValueError, match="negative, infinite or no number"):
        prefilter_sky(environment, SkyConfig(resolution=32, samples_per_edge=1))


@pytest.mark.parametrize("resolution", [8, 100, 4096])
def test_sizes_that_do_not_halve_are_refused(resolution: int) -> None:
    with pytest.raises(ValueError, match="resolution"):
        SkyConfig(resolution=resolution)
    with pytest.raises(ValueError, match="sky_lighting"):
        RenderConfig(sky_lighting="both")  # type: ignore[arg-type]
