"""Which side of a triangle goes into the voxels: the one that light paths meet."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import SceneDict, area_light, camera, diffuse, load, room
from vctgi.scene.materials import describe_material
from vctgi.scene.surfaces import VoxelSurfaces, select_surfaces
from vctgi.scene.triangles import extract_triangles

pytestmark = pytest.mark.usefixtures("variant")


def two_sided(value: float = 0.5) -> SceneDict:
    return {"type": "twosided", "bsdf": diffuse(value)}


def select(**parts: Any) -> VoxelSurfaces:
    lamp = {"type": "sphere", "radius": 0.1, "center": [0, 0.5, 0], "emitter": area_light()}
    eye = camera([0.2, 0.1, 0.9], [0.0, 0.0, 0.0], fov=90.0)
    scene = load(sensor=eye, lamp=lamp, **parts)
    triangles = extract_triangles(scene)
    materials = [describe_material(bsdf) for bsdf in triangles.bsdfs]
    return select_surfaces(scene, scene.sensors()[0], triangles, materials)


def wall_normals(surfaces: VoxelSurfaces) -> tuple[np.ndarray, np.ndarray]:
    """Centres and normals of the sides that lie on the walls of the room from -1 to 1."""
    v = surfaces.vertices
    normal = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    centre = v.mean(axis=1)
    is_wall = np.abs(centre).max(axis=1) > 0.99
    return centre[is_wall], normal[is_wall]


@pytest.mark.parametrize("is_wound_wrong", [False, True])
def test_two_sided_walls_are_turned_to_the_room(is_wound_wrong: bool) -> None:
    walls = room(bsdf=two_sided())
    if is_wound_wrong:
        for wall in walls.values():
            wall["to_world"] = wall["to_world"] @ mi.ScalarTransform4f().rotate([0, 1, 0], 180)
    found = select(**walls)
    centre, normal = wall_normals(found)
    assert len(centre) == 12
    assert np.all(np.einsum("ti,ti->t", centre, normal) < 0.0)
    assert found.flipped_count == (12 if is_wound_wrong else 0)
    assert found.double_count == 0


def test_one_sided_walls_keep_their_winding_even_if_nobody_sees_the_front() -> None:
    walls = room()
    for wall in walls.values():
        wall["to_world"] = wall["to_world"] @ mi.ScalarTransform4f().rotate([0, 1, 0], 180)
    found = select(**walls)
    centre, normal = wall_normals(found)
    assert np.all(np.einsum("ti,ti->t", centre, normal) > 0.0)
    assert found.flipped_count == found.double_count == 0


def test_curtain_that_is_seen_from_both_sides_gets_both() -> None:
    place = mi.ScalarTransform4f().translate([0.0, -0.2, 0.0]).rotate([0, 1, 0], 90).scale(0.5)
    curtain = {"type": "rectangle", "to_world": place, "bsdf": two_sided()}
    found = select(curtain=curtain, **room())
    assert found.double_count == 2
    assert found.flipped_count == 0
    # Both windings of the same two triangles.
    middle = np.abs(found.vertices[..., 0]).max(axis=1) < 1e-6
    v = found.vertices[middle]
    normal = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])[:, 0]
    assert sorted(np.sign(normal)) == [-1, -1, 1, 1]


def test_one_sided_screen_gets_its_front_only() -> None:
    place = mi.ScalarTransform4f().translate([0.0, -0.2, 0.0]).rotate([0, 1, 0], 90).scale(0.5)
    screen = {"type": "rectangle", "to_world": place, "bsdf": diffuse()}
    found = select(screen=screen, **room())
    assert found.double_count == found.flipped_count == 0


def test_masked_surfaces_name_their_mask() -> None:
    mask = {"type": "mask", "opacity": 0.3, "bsdf": diffuse()}
    place = mi.ScalarTransform4f().scale(0.5)
    found = select(leaf={"type": "rectangle", "to_world": place, "bsdf": mask}, **room())
    assert len(found.masks) == 1
    assert np.count_nonzero(found.mask_index == 0) >= 2
    assert np.count_nonzero(found.mask_index == -1) > 12
