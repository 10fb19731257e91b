"""Twice the light is twice the picture, no light is no picture, two lamps are the sum of each."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import SceneDict, area_light, camera, color, grey, load, room
from vctgi.clipmap.storage import StorageConfig
from vctgi.config import preset
from vctgi.pipeline import Frame, light_volume, prepare_scene, render_frame

pytestmark = pytest.mark.usefixtures("variant")

SCALED_LIGHT = 1e-5
"""Relative: a factor that is no power of two rounds every number of the way."""

SUM_OF_LIGHTS = 1e-4
"""Relative: sums in single precision, in another order."""

COMPONENTS = ("indirect_diffuse", "indirect_specular")


def lamp(strength: float) -> SceneDict:
    place = mi.ScalarTransform4f().translate([0.2, 0.9, 0.1]).rotate([1, 0, 0], 90).scale(0.2)
    return {"type": "rectangle", "to_world": place, "emitter": area_light(strength)}


def point(strength: float) -> SceneDict:
    return {"type": "point", "position": [-0.4, 0.2, 0.3], "intensity": grey(strength)}


EXACT = StorageConfig()
"""Half precision rounds each voxel by itself, so that only factors of 2 keep every bit."""


def picture(storage: StorageConfig = EXACT, **lights: SceneDict) -> Frame:
    walls = room(bsdf={"type": "diffuse", "reflectance": color(0.7, 0.4, 0.2)})
    walls["wall0"] = {**walls["wall0"], "bsdf": {"type": "roughconductor", "alpha": 0.2}}
    scene = load(sensor=camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], fov=80.0), **walls, **lights)
    config = preset("medium")
    clipmap = replace(config.clipmap, resolution=32)
    config = replace(config, clipmap=clipmap, storage=storage, samples_per_pixel=1)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    return render_frame(prepared, light_volume(prepared, config).volume, config)


def components(frame: Frame) -> list[np.ndarray]:
    return [np.array(getattr(frame, name)) for name in COMPONENTS]


@pytest.mark.parametrize("storage", [EXACT, preset("medium").storage])
def test_doubling_the_light_doubles_every_bit_of_the_picture(storage: StorageConfig) -> None:
    once, twice = (components(picture(storage, lamp=lamp(value))) for value in (1.5, 3.0))
    for single, double in zip(once, twice, strict=True):
        assert single.mean() > 0.0
        np.testing.assert_array_equal(double, 2.0 * single)


@pytest.mark.parametrize("factor", [3e-6, 0.3, 7.7e5])
def test_picture_is_linear_over_many_orders_of_the_light(factor: float) -> None:
    once, scaled = (components(picture(lamp=lamp(value))) for value in (1.5, 1.5 * factor))
    for single, other in zip(once, scaled, strict=True):
        np.testing.assert_allclose(
            other, factor * single, rtol=SCALED_LIGHT, atol=SCALED_LIGHT * factor * single.mean()
        )


def test_no_light_is_no_picture() -> None:
    for image in components(picture(lamp=lamp(0.0), point=point(0.0))):
        assert not image.any()


def test_two_lamps_give_the_sum_of_each() -> None:
    lights: dict[str, Any] = {"lamp": lamp(1.5), "point": point(0.4)}
    both = components(picture(**lights))
    # The dark lamp stays, so that the scene's geometry is the same.
    only_lamp = components(picture(**{**lights, "point": point(0.0)}))
    only_point = components(picture(**{**lights, "lamp": lamp(0.0)}))
    for together, first, second in zip(both, only_lamp, only_point, strict=True):
        np.testing.assert_allclose(
            together, first + second, rtol=SUM_OF_LIGHTS, atol=SUM_OF_LIGHTS * together.mean()
        )


def test_color_of_the_light_is_the_color_of_its_picture() -> None:
    red = {"type": "point", "position": [0.0, 0.3, 0.0], "intensity": color(2.0, 0.0, 0.0)}
    for image in components(picture(lamp=red)):
        assert image[..., 0].mean() > 0.0
        assert not image[..., 1:].any()
