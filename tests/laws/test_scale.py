"""Radiance does not depend on the unit of length, nor on where the world has its origin.

What is left are the roundings of single precision, in which Mitsuba keeps vertices and rays.
"""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import SceneDict, area_light, camera, diffuse, load, oblique, room
from vctgi.config import preset
from vctgi.errors import SceneError
from vctgi.pipeline import light_volume, prepare_scene, render_frame

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 32

VOXEL = 0.1
"""Voxel over half the room: moves by 100 000 rooms' halves of 1000 keep the grid's phase."""

SAME_PICTURE = 1e-3
"""Mean absolute difference over the mean. Cones step over the same voxels at other roundings."""

MOVED_PICTURE = 2e-3
"""The same for a room that stands 100 of its halves from the origin: rays have two digits less."""


def furnished_room(scale: float, offset: float = 0.0) -> mi.Scene:
    """Return a room with a lamp and a turned box, all lengths scaled and then moved."""
    outer = mi.ScalarTransform4f().translate([offset] * 3).scale(scale)
    lamp_place = mi.ScalarTransform4f().translate([0, 0.95, 0]).rotate([1, 0, 0], 90).scale(0.3)
    lamp = {"type": "rectangle", "to_world": outer @ lamp_place, "emitter": area_light(5.0)}
    box_place = mi.ScalarTransform4f().translate([-0.3, -0.6, -0.2]) @ oblique().scale(0.3)
    box = {"type": "cube", "to_world": outer @ box_place, "bsdf": diffuse(0.7)}
    # The camera's own transform must not scale.
    eye: SceneDict = camera(
        [offset + scale * x for x in (0.0, 0.0, 0.95)],
        [offset + scale * x for x in (0.0, -0.1, 0.0)],
        size=24,
        fov=80.0,
    )
    eye |= {"near_clip": 1e-3 * scale, "far_clip": 1e3 * scale}
    return load(sensor=eye, lamp=lamp, box=box, **room(outer, bsdf=diffuse(0.6)))


def picture(scale: float, offset: float = 0.0) -> np.ndarray:
    """Indirect light of the room, by voxels that have the same place in it."""
    scene = furnished_room(scale, offset)
    config = preset("high")
    config = replace(
        config,
        samples_per_pixel=1,
        clipmap=replace(
            config.clipmap,
            resolution=RESOLUTION,
            finest_voxel_size=VOXEL * scale,
            centre=(offset,) * 3,
            level_count=1,
        ),
    )
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    image: np.ndarray = np.array(frame.indirect_diffuse)
    assert np.isfinite(image).all()
    assert np.isfinite(np.array(frame.depth)).all()
    return image


def difference(image: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(image - reference).mean() / reference.mean())


def test_a_power_of_two_changes_no_bit() -> None:
    np.testing.assert_array_equal(picture(2.0**20), picture(1.0))


@pytest.mark.parametrize("scale", [1e-4, 1e-2, 1e6])
def test_the_unit_of_length_does_not_matter(scale: float) -> None:
    assert difference(picture(scale), picture(1.0)) <= SAME_PICTURE


def test_the_origin_does_not_matter() -> None:
    assert difference(picture(1e3, offset=1e5), picture(1.0)) <= MOVED_PICTURE


def test_a_room_that_single_precision_cannot_hold_gives_no_nan() -> None:
    # Vertices of a room of size 2 stand 1 / 128 apart there, and rays start 9 from their surface.
    picture(1.0, offset=1e5)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_a_vertex_that_is_no_number_is_one_clear_error(value: float) -> None:
    scene = furnished_room(1.0)
    box = next(shape for shape in scene.shapes() if shape.id() == "box")
    parameters = mi.traverse(box)
    positions = np.array(parameters["vertex_positions"])
    positions[4] = value
    parameters["vertex_positions"] = mi.Float(positions)
    parameters.update()
    with pytest.raises(SceneError, match=r"NaN or infinite.*box.*repair the mesh") as error:
        prepare_scene(scene, scene.sensors()[0], preset("medium"))
    assert "\n" not in str(error.value)


def test_an_empty_scene_is_a_clear_error() -> None:
    scene = load(sensor=camera([0, 0, 1], [0, 0, 0]), sky={"type": "constant"})
    with pytest.raises(SceneError, match=r"no geometry.*add at least one shape"):
        prepare_scene(scene, scene.sensors()[0], preset("medium"))
