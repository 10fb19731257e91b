"""Frames over time: a mean where nothing moves, the same surface where the eye does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from vctgi.errors import SceneError
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.reconstruction.temporal import (
    TemporalConfig,
    TemporalFrame,
    accumulate,
    place_of,
    project,
)

pytestmark = pytest.mark.usefixtures("variant")

WIDTH, HEIGHT = 40, 30

ROUNDING = 2e-4
"""Relative. Places are found in single precision, and a 1e-5 of a pixel reads the next one."""

PIXEL_ROUNDING = 2e-3
"""Pixels: the same in a picture of a hundred."""

FOREVER = TemporalConfig(max_frame_count=None)


def eye(origin: tuple[float, float, float], **more: Any) -> mi.Sensor:
    look = mi.ScalarTransform4f().look_at([*origin], [origin[0], origin[1], 5.0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT}
    described = {"type": "perspective", "fov": 50.0, "to_world": look, "film": film, **more}
    sensor: mi.Sensor = mi.load_dict(described)
    return sensor


def wall_seen_by(sensor: mi.Sensor, depth: float, light: Any) -> TemporalFrame:
    """Return a frame of the plane z = depth, whose light is a function of x and y."""
    crop = sensor.film().crop_size()
    pixel = dr.arange(mi.UInt32, int(crop[0]) * int(crop[1]))
    place = mi.Point2f(pixel % int(crop[0]), pixel // int(crop[0])) + 0.5
    position = place / mi.Point2f(float(crop[0]), float(crop[1]))
    ray, _ = sensor.sample_ray(as_component(0.0), as_component(0.5), position, mi.Point2f(0.5))
    p = ray(as_component((depth - ray.o.z) / ray.d.z))
    count = dr.width(p)
    return TemporalFrame(
        projection=project(sensor),
        irradiance=mi.Color3f(light(p.x, p.y)) + dr.zeros(mi.Color3f, count),
        specular=dr.zeros(mi.Color3f, count),
        position=p,
        normal=mi.Vector3f(0.0, 0.0, -1.0) + dr.zeros(mi.Vector3f, count),
        frame_count=dr.full(mi.Float, 1.0, count),
    )


def irradiance(frame: TemporalFrame) -> np.ndarray:
    green: np.ndarray = np.array(frame.irradiance)[1]
    return green


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"principal_point_offset_x": 0.2, "principal_point_offset_y": -0.1},
        {"fov_axis": "y"},
        {
            "film": {
                "type": "hdrfilm",
                "width": 90,
                "height": 60,
                "crop_width": WIDTH,
                "crop_height": HEIGHT,
                "crop_offset_x": 13,
                "crop_offset_y": 7,
            }
        },
    ],
    ids=["plain", "shifted lens", "vertical field of view", "crop"],
)
def test_points_fall_back_on_the_pixels_that_see_them(more: dict[str, Any]) -> None:
    sensor = eye((0.3, -0.2, 0.1), **more)
    frame = wall_seen_by(sensor, 4.0, lambda x, y: x)
    place, depth = place_of(frame.projection, frame.position)
    pixel = np.arange(WIDTH * HEIGHT)
    np.testing.assert_allclose(np.array(place)[0], pixel % WIDTH + 0.5, atol=PIXEL_ROUNDING)
    np.testing.assert_allclose(np.array(place)[1], pixel // WIDTH + 0.5, atol=PIXEL_ROUNDING)
    np.testing.assert_allclose(np.array(depth), 3.9, rtol=ROUNDING)


def test_still_eye_converges_to_the_mean() -> None:
    rng = np.random.default_rng(0)
    sensor = eye((0.0, 0.0, 0.0))
    frames, history = [], None
    for _ in range(6):
        values = rng.uniform(0.5, 1.5, WIDTH * HEIGHT).astype(np.float32)
        frame = wall_seen_by(sensor, 4.0, lambda x, _y, values=values: mi.Float(values) + 0.0 * x)
        frames.append(values)
        history = accumulate(history, frame, FOREVER)
    assert history is not None
    np.testing.assert_allclose(irradiance(history), np.mean(frames, axis=0), rtol=10 * ROUNDING)
    np.testing.assert_allclose(np.array(history.frame_count), 6.0, rtol=ROUNDING)


def test_old_frames_fade_at_the_stated_rate() -> None:
    sensor = eye((0.0, 0.0, 0.0))
    config = TemporalConfig(max_frame_count=4)
    history = None
    for number in range(12):
        value = 1.0 if number < 8 else 0.0
        frame = wall_seen_by(sensor, 4.0, lambda _x, _y, value=value: value)
        history = accumulate(history, frame, config)
    assert history is not None
    np.testing.assert_allclose(irradiance(history), 0.75**4, rtol=ROUNDING)


def test_moved_eye_finds_the_same_light_on_a_textured_plane() -> None:
    def texture(x: mi.Float, y: mi.Float) -> mi.Float:
        return 2.0 + 0.3 * x - 0.2 * y

    first = wall_seen_by(eye((0.0, 0.0, 0.0)), 4.0, texture)
    # The new frame is black: what is seen is half of what was found.
    second = wall_seen_by(eye((0.91, -0.43, 0.4)), 4.0, lambda _x, _y: 0.0)
    found = accumulate(first, second, FOREVER)
    has_history = np.array(found.frame_count) > 1.5
    assert has_history.mean() > 0.5
    x, y = np.array(second.position)[:2]
    expected = 0.5 * (2.0 + 0.3 * x - 0.2 * y)
    # At the rim of the old picture the nearest pixels stand for what lies beyond them.
    px, py = np.array(place_of(first.projection, second.position)[0])
    inside = (px > 0.5) & (py > 0.5) & (px < WIDTH - 0.5) & (py < HEIGHT - 0.5)
    np.testing.assert_allclose(irradiance(found)[inside], expected[inside], rtol=10 * ROUNDING)
    outside = (px < -0.5) | (py < -0.5) | (px > WIDTH + 0.5) | (py > HEIGHT + 0.5)
    assert outside.any()
    np.testing.assert_array_equal(irradiance(found)[outside], 0.0)
    np.testing.assert_array_equal(np.array(found.frame_count)[outside], 1.0)


def test_what_was_hidden_before_starts_anew() -> None:
    before = wall_seen_by(eye((0.0, 0.0, 0.0)), 2.0, lambda _x, _y: 9.0)
    behind = wall_seen_by(eye((0.0, 0.0, 0.0)), 4.0, lambda _x, _y: 1.0)
    found = accumulate(before, behind, FOREVER)
    np.testing.assert_array_equal(irradiance(found), 1.0)
    np.testing.assert_array_equal(np.array(found.frame_count), 1.0)


def test_turned_surface_starts_anew() -> None:
    sensor = eye((0.0, 0.0, 0.0))
    old = wall_seen_by(sensor, 4.0, lambda _x, _y: 9.0)
    old.normal = mi.Vector3f(0.0, 0.8, -0.6) + dr.zeros(mi.Vector3f, WIDTH * HEIGHT)
    found = accumulate(old, wall_seen_by(sensor, 4.0, lambda _x, _y: 1.0), FOREVER)
    np.testing.assert_array_equal(irradiance(found), 1.0)


def test_pixels_that_see_nothing_have_no_history() -> None:
    sensor = eye((0.0, 0.0, 0.0))
    old, new = (wall_seen_by(sensor, 4.0, lambda _x, _y, v=v: v) for v in (9.0, 1.0))
    new.normal = dr.zeros(mi.Vector3f, WIDTH * HEIGHT)
    np.testing.assert_array_equal(irradiance(accumulate(old, new, FOREVER)), 1.0)


def test_history_is_left_as_it_was() -> None:
    sensor = eye((0.0, 0.0, 0.0))
    old, new = (wall_seen_by(sensor, 4.0, lambda _x, _y, v=v: v) for v in (9.0, 1.0))
    accumulate(old, new, FOREVER)
    np.testing.assert_array_equal(irradiance(old), 9.0)
    np.testing.assert_array_equal(irradiance(new), 1.0)


def test_other_cameras_are_refused() -> None:
    sensor: mi.Sensor = mi.load_dict({"type": "orthographic", "id": "plan"})
    with pytest.raises(SceneError, match="OrthographicCamera cannot be followed"):
        project(sensor)


@pytest.mark.parametrize(
    ("name", "value"),
    [("max_frame_count", 0), ("max_plane_slope", 0.0), ("max_normal_angle", 4.0)],
)
def test_impossible_settings_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        replace(TemporalConfig(), **{name: value})  # type: ignore[arg-type]
