"""Ambient occlusion against closed forms and against real rays with the same falloff.

An open plane is open, a point in a corner of two half planes sees what they leave of the cosine,
and a closed room is closed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from experiments.studies.accuracy.ambient import ambient_by_rays
from tests.vctgi.small_scenes import camera, diffuse, load, room
from tests.vctgi.surface_points import points_in_room
from vctgi.config import RenderConfig, preset
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.ambient import AmbientConfig, trace_ambient

pytestmark = pytest.mark.usefixtures("variant")

OPEN = 0.01
"""What may be missing of the hemisphere over an even plane."""

CLOSED = 0.07
"""What wide cones may see through the walls of a closed room, mean over its points: 17 of them lose
as much of a furnace's light. Measured 0.056."""

CORNER = 0.04
"""Difference from the closed form at points two voxels and more from a corner, mean over them."""

BY_RAYS = 0.05
"""Mean absolute difference from real rays."""


def settings(reach: float | None, cone_count: int = 17) -> RenderConfig:
    config = preset("ambient")
    return replace(
        config,
        ambient=AmbientConfig(cone_count=cone_count, range_world=reach, range_share=None),
        samples_per_pixel=1,
    )


def openness(scene: mi.Scene, config: RenderConfig, points: np.ndarray, normals: Any) -> np.ndarray:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume
    normals = np.broadcast_to(np.array(normals, float), points.shape)
    return np.array(trace_ambient(white_receivers(points, normals), volume, config.ambient, scene))


def floor(**more: Any) -> dict[str, Any]:
    turn = mi.ScalarTransform4f().rotate([1, 0, 0], -90)
    return {"type": "rectangle", "to_world": turn, "bsdf": diffuse(), **more}


def grid(x: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    u, w = np.meshgrid(np.linspace(*x, 24), np.linspace(*z, 24))
    return np.stack([u.ravel(), np.zeros(u.size), w.ravel()], axis=1)


@pytest.mark.parametrize("reach", [None, 0.3])
def test_open_plane_is_open(reach: float | None) -> None:
    scene = load(sensor=camera([0.0, 1.0, 2.0], [0.0, 0.0, 0.0]), floor=floor())
    found = openness(scene, settings(reach), grid((-0.8, 0.8), (-0.8, 0.8)), (0.0, 1.0, 0.0))
    assert found.min() >= 1.0 - OPEN
    assert found.max() <= 1.0


def test_corner_of_two_planes_is_its_closed_form() -> None:
    # A wall of height h at distance x leaves (1 + x / sqrt(x^2 + h^2)) / 2 of a floor's cosine, as
    # long as it is: the view factor of an infinite strip.
    wall = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f()
        .translate([-1, 1, 0])
        .rotate([0, 1, 0], 90)
        .scale([12, 1, 1]),
        "bsdf": diffuse(),
    }
    ground = floor(to_world=mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale([1, 12, 1]))
    eye = camera([0.9, 1.0, 2.0], [-0.5, 0.0, 0.0])
    scene = load(sensor=eye, floor=ground, wall=wall)
    config = settings(None)
    clipmap = replace(config.clipmap, finest_voxel_size=0.05, centre=(-0.5, 0.5, 0.0))
    points = grid((-0.9, 0.9), (-0.5, 0.5))
    found = openness(scene, replace(config, clipmap=clipmap), points, (0.0, 1.0, 0.0))
    distance = points[:, 0] + 1.0
    expected = 0.5 * (1.0 + distance / np.hypot(distance, 2.0))
    assert np.abs(found - expected).mean() <= CORNER
    assert abs(float((found - expected).mean())) <= CORNER


def test_closed_room_is_closed() -> None:
    scene = load(sensor=camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], fov=80.0), **room())
    points, normals = points_in_room(500, seed=2)
    found = openness(scene, settings(None), points, normals)
    assert found.mean() <= CLOSED


@pytest.mark.parametrize("reach", [0.2, 1.0])
def test_room_with_falloff_is_what_rays_find(reach: float) -> None:
    scene = load(sensor=camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], fov=80.0), **room())
    points, normals = points_in_room(300, seed=2)
    found = openness(scene, settings(reach), points, normals)
    exact = ambient_by_rays(
        scene,
        mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(normals.T, dtype=np.float32)),
        reach,
        64,
    )
    assert np.abs(found - exact).mean() <= BY_RAYS


def test_rays_find_the_closed_form_of_a_floor() -> None:
    # Sphere of radius r around its centre, all rays of length r: the truth of the truth.
    shell = {"type": "sphere", "radius": 2.0, "flip_normals": True}
    scene = load(sensor=camera([0.5, 0.2, 0.9], [0.0, 0.0, 0.0]), shell=shell)
    position, normal = mi.Point3f([0.0], [0.0], [0.0]), mi.Vector3f([0.0], [1.0], [0.0])
    found = ambient_by_rays(scene, position, normal, 1.5, 64)
    assert found[0] == pytest.approx(1.0 - math.exp(-2.0 / 1.5), abs=1e-3)


def test_nothing_but_opacity_is_needed() -> None:
    unlit = load(sensor=camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], fov=80.0), **room())
    config = preset("ambient")
    prepared = prepare_scene(unlit, unlit.sensors()[0], config)
    lit = light_volume(prepared, config)
    assert lit.texel_count == 0
    frame = render_frame(prepared, lit.volume, config)
    assert frame.ambient is not None
    ambient = np.array(frame.ambient)
    assert ambient.shape == (16, 16, 1)
    assert 0.0 < ambient.min() < ambient.max() <= 1.0
    assert not np.array(frame.indirect_diffuse).any()
    left_out = {entry.item: entry for entry in prepared.plan.entries if not entry.kept}
    for item in ("reflective shadow maps", "light injection", "bounces from voxel to voxel"):
        assert left_out[item].saved


def test_background_is_open() -> None:
    scene = load(sensor=camera([0.0, 1.0, 2.0], [0.0, 3.0, -9.0]), floor=floor())
    config = replace(preset("ambient"), samples_per_pixel=1)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    is_sky = np.array(frame.depth) == 0.0
    assert is_sky.any()
    np.testing.assert_array_equal(np.array(frame.ambient)[is_sky], 1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cone_count": 0}, "no set of 0 cones"),
        ({"near_field_voxels": -1.0}, "near_field_voxels must be >= 0"),
        ({"range_world": 1.0}, "two ways to say one thing"),
        ({"range_share": 0.0}, "range_share must be > 0"),
        ({"range_share": None, "range_world": -1.0}, "range_world must be > 0"),
    ],
)
def test_impossible_settings_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        AmbientConfig(**changes)
