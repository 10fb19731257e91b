"""Frames of a scene that goes on: nothing is done again that nothing changed, and nothing stale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import vctgi
from tests.vctgi.small_scenes import camera, diffuse, grey, load, room
from vctgi.config import RenderConfig
from vctgi.scene.state import scene_state

pytestmark = pytest.mark.usefixtures("variant")


def settings() -> RenderConfig:
    config = vctgi.preset("medium")
    clipmap = replace(config.clipmap, resolution=16, finest_voxel_size=0.2, centre=(0.0, 0.0, 0.0))
    return replace(config, clipmap=clipmap, samples_per_pixel=1)


def lit_room() -> mi.Scene:
    lamp = {"type": "point", "position": [0.1, 0.2, 0.0], "intensity": grey(1.0)}
    box = {"type": "cube", "to_world": mi.ScalarTransform4f().scale(0.2), "bsdf": diffuse(0.4)}
    eye = camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=8, fov=80.0)
    return load(sensor=eye, lamp=lamp, box=box, **room())


def picture(followed: vctgi.FollowedScene) -> np.ndarray:
    frame = vctgi.render_frame(followed.prepared, followed.lit.volume, followed.config)
    return np.array(frame.indirect_diffuse)


def move_lamp(parameters: mi.SceneParameters) -> None:
    parameters["lamp.position"] = mi.Point3f(-0.3, 0.4, 0.1)


def dim_lamp(parameters: mi.SceneParameters) -> None:
    parameters["lamp.intensity.value"] = mi.Color3f(0.5)


def paint_box(parameters: mi.SceneParameters) -> None:
    parameters["box.bsdf.reflectance.value"] = mi.Color3f(0.9, 0.1, 0.1)


def move_box(parameters: mi.SceneParameters) -> None:
    corners = np.array(parameters["box.vertex_positions"]).reshape(-1, 3)
    shifted = corners + np.array([0.3, 0.0, 0.1])
    parameters["box.vertex_positions"] = mi.Float(shifted.astype(np.float32).ravel())


def write_into_box(parameters: mi.SceneParameters) -> None:
    """Overwrite an array that the state holds, in place."""
    held = parameters["box.vertex_positions"]
    dr.scatter(held, mi.Float(0.35), mi.UInt32(0))
    parameters["box.vertex_positions"] = held


def turn_camera(parameters: mi.SceneParameters) -> None:
    turned = mi.ScalarTransform4f().look_at([0.4, 0.3, 0.8], [0.1, -0.3, 0.0], [0, 1, 0])
    parameters["sensor.to_world"] = mi.AffineTransform4f(turned.matrix)


CHANGES = [move_lamp, dim_lamp, paint_box, move_box, write_into_box, turn_camera]


def test_a_still_scene_is_not_voxelized_or_lit_again() -> None:
    scene, config = lit_room(), settings()
    sensor = scene.sensors()[0]
    first = vctgi.follow_scene(None, scene, sensor, config)
    second = vctgi.follow_scene(first, scene, sensor, config)
    assert second.is_reused
    assert second.lit is first.lit
    scratch = vctgi.follow_scene(second, scene, sensor, replace(config, keep=("motion",)))
    assert not scratch.is_reused
    assert np.array_equal(picture(second), picture(scratch))


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_seen_and_equals_a_frame_from_scratch(
    change: Callable[[mi.SceneParameters], None],
) -> None:
    scene, config = lit_room(), settings()
    sensor = scene.sensors()[0]
    first = vctgi.follow_scene(None, scene, sensor, config)
    before = picture(first)
    parameters = mi.traverse(scene)
    change(parameters)
    parameters.update()
    second = vctgi.follow_scene(first, scene, sensor, config)
    assert not second.is_reused
    after = picture(second)
    assert not np.array_equal(before, after)
    assert np.array_equal(after, picture(vctgi.follow_scene(None, scene, sensor, config)))


def test_another_configuration_or_camera_is_a_change() -> None:
    scene, config = lit_room(), settings()
    sensor = scene.sensors()[0]
    first = vctgi.follow_scene(None, scene, sensor, config)
    more = replace(config, scattering_count=3)
    assert not vctgi.follow_scene(first, scene, sensor, more).is_reused
    other = mi.load_dict(camera([0.4, 0.3, 0.8], [0.1, -0.3, 0.0], size=8, fov=80.0))
    assert not scene_state(scene, sensor).is_same(scene_state(scene, other))


def test_a_parameter_with_derivatives_counts_as_changed() -> None:
    scene = lit_room()
    sensor = scene.sensors()[0]
    before = scene_state(scene, sensor)
    assert before.is_same(scene_state(scene, sensor))
    parameters = mi.traverse(scene)
    dr.enable_grad(parameters["lamp.intensity.value"])
    parameters.update()
    assert not before.is_same(scene_state(scene, sensor))
