"""Mirrored scenes: a negative scale turns the winding of a mesh, not the side that is shaded."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import area_light, camera, load, room
from vctgi.config import RenderConfig
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.scene.triangles import extract_triangles

pytestmark = pytest.mark.usefixtures("variant")

MIRRORS = [(-1.0, 1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, -1.0, -1.0)]

NOISE = 0.03
"""Relative, in the mean: the lamp's rays and the turns of cones are not mirrored with the room."""


def mirrored_room(factors: tuple[float, float, float]) -> mi.Scene:
    outer = mi.ScalarTransform4f().scale(list(factors))
    place = mi.ScalarTransform4f().translate([0, 0.9, 0]).rotate([1, 0, 0], 90).scale(0.3)
    lamp = {"type": "rectangle", "to_world": outer @ place, "emitter": area_light(5.0)}
    eye, target = (
        (np.array(factors) * each).tolist() for each in ([0.5, 0.2, 0.9], [0.0, -0.2, 0.0])
    )
    return load(sensor=camera(eye, target, fov=80.0), lamp=lamp, **room(outer))


def light_in(scene: mi.Scene) -> float:
    config = RenderConfig(samples_per_pixel=1)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    return float(np.array(frame.indirect_diffuse).mean())


@pytest.mark.parametrize("factors", MIRRORS)
def test_faces_of_a_mirrored_room_look_inwards(factors: tuple[float, float, float]) -> None:
    triangles = extract_triangles(mirrored_room(factors))
    inward = -np.einsum("ij,ij->i", triangles.normals, triangles.vertices.mean(axis=1))
    assert (inward > 0.5).all()


def test_mirrored_room_has_the_light_of_the_room() -> None:
    truth = light_in(mirrored_room((1.0, 1.0, 1.0)))
    assert truth > 0.0
    assert light_in(mirrored_room(MIRRORS[0])) == pytest.approx(truth, rel=NOISE)


def test_winding_holds_where_vertices_have_no_normals() -> None:
    made = mi.Mesh("bare", 3, 1)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mi.Float([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    parameters["faces"] = mi.UInt32([0, 2, 1])
    parameters.update()
    (normal,) = extract_triangles(load(bare=made)).normals
    np.testing.assert_allclose(normal, [0.0, 0.0, -1.0])
