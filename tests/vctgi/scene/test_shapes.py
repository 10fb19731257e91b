"""Analytic shapes, instances and meshes become the triangles that rays hit."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import SceneDict, diffuse, load, turned
from vctgi.scene.shapes import CHORD_ERROR, list_shapes
from vctgi.scene.triangles import SceneTriangles, extract_triangles

pytestmark = pytest.mark.usefixtures("variant")

SINGLE_PRECISION = 2e-6
"""Relative rounding of positions that Mitsuba transforms in single precision."""

BOTH_WAYS = 2.2
"""A cell of a grid over a sphere is bent along u and along v; its diagonal sags by both, and the
rounding of the arcs up to whole segments leaves a tenth of the room unused."""

NORMAL_OF_A_CHORD = 0.98
"""Cosine between a chord's triangle and the smooth surface: half a segment of 71 turns 2.5 degrees,
at the poles of a sphere a whole one."""


def triangles_of(**parts: SceneDict) -> SceneTriangles:
    return extract_triangles(load(**parts))


def areas(vertices: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[:, corner] for corner in range(3))
    area: np.ndarray = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return area


def points_inside(vertices: np.ndarray, count: int = 8) -> np.ndarray:
    """Random points [triangle, count, 3] on triangles."""
    rng = np.random.default_rng(0)
    share = rng.dirichlet([1.0, 1.0, 1.0], (len(vertices), count))
    points: np.ndarray = np.einsum("tpc,tci->tpi", share, vertices)
    return points


def placed(**more: Any) -> SceneDict:
    to_world = mi.ScalarTransform4f().translate([1.0, -2.0, 3.0]) @ turned((1, 2, 3), 33).scale(2.5)
    return {"to_world": to_world, "bsdf": diffuse(), **more}


CENTRE = np.array([1.0, -2.0, 3.0])


@pytest.mark.parametrize("is_flipped", [False, True])
def test_sphere_keeps_its_chord_error_its_area_and_its_outside(is_flipped: bool) -> None:
    found = triangles_of(s={"type": "sphere", **placed(flip_normals=is_flipped)})
    radius = 2.5
    corners = np.linalg.norm(found.vertices - CENTRE, axis=-1)
    np.testing.assert_allclose(corners, radius, rtol=SINGLE_PRECISION)
    inside = np.linalg.norm(points_inside(found.vertices) - CENTRE, axis=-1)
    assert np.all(radius - inside <= BOTH_WAYS * CHORD_ERROR * radius)
    # Inscribed: too small, by at most twice the chord error in each of two directions.
    exact = 4.0 * math.pi * radius**2
    total = areas(found.vertices).sum()
    assert (1.0 - 4.0 * CHORD_ERROR) * exact <= total < exact
    outward = np.einsum("ti,ti->t", found.normals, found.vertices.mean(axis=1) - CENTRE)
    assert np.all(outward < 0.0 if is_flipped else outward > 0.0)
    assert not found.degenerate_counts


def test_disk_and_cylinder_keep_their_area() -> None:
    disk = triangles_of(s={"type": "disk", **placed()})
    exact = math.pi * 2.5**2
    assert (1.0 - 2.0 * CHORD_ERROR) * exact <= areas(disk.vertices).sum() < exact
    tube = triangles_of(s={"type": "cylinder", "p0": [0, 1, 0], "p1": [2, 4, 1], "radius": 0.7})
    exact = 2.0 * math.pi * 0.7 * math.sqrt(14.0)
    assert (1.0 - CHORD_ERROR) * exact <= areas(tube.vertices).sum() < exact


SHAPES: dict[str, SceneDict] = {
    "sphere": {"type": "sphere"},
    "disk": {"type": "disk"},
    "cylinder": {"type": "cylinder", "p0": [0, -0.4, 0.1], "p1": [0.2, 0.6, 0], "radius": 0.3},
    "rectangle": {"type": "rectangle"},
    "cube": {"type": "cube"},
}


def moves(name: str) -> mi.ScalarAffineTransform4f:
    whole = mi.ScalarTransform4f()
    placed: dict[str, mi.ScalarAffineTransform4f] = {
        "as it is": whole,
        "turned": whole.translate([0.3, 0.1, -2.0]) @ turned((1, 2, 3), 33),
        "mirrored": whole.scale([-1.0, 1.0, 1.0]) @ turned((3, 1, 1), 70),
    }
    return placed[name]


def assert_faces_are_what_rays_hit(scene: mi.Scene, found: SceneTriangles) -> None:
    """Shoot a ray at the front of triangles: it must hit there, and see a front-facing normal."""
    chosen = np.linspace(0, found.triangle_count - 1, 60).astype(int)
    centre, normal = found.vertices[chosen].mean(axis=1), found.normals[chosen]
    start = centre + 0.01 * normal
    ray = mi.Ray3f(
        mi.Point3f(np.ascontiguousarray(start.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(-normal.T, dtype=np.float32)),
    )
    si = scene.ray_intersect(ray)
    assert np.all(np.array(si.is_valid()))
    # Not more than the distance and the sag of a chord away.
    np.testing.assert_allclose(np.array(si.t), 0.01, atol=BOTH_WAYS * CHORD_ERROR)
    # BSDFs are asked for the side of the shading normal, which a mirroring leaves where it is.
    cosine = np.einsum("it,ti->t", np.array(si.sh_frame.n), normal)
    assert np.all(cosine >= NORMAL_OF_A_CHORD)


@pytest.mark.parametrize("move", ["as it is", "turned", "mirrored"])
@pytest.mark.parametrize("is_flipped", [False, True], ids=["normal", "flipped"])
@pytest.mark.parametrize("kind", SHAPES)
def test_fronts_of_triangles_are_the_sides_of_mitsubas_normals(
    kind: str, is_flipped: bool, move: str
) -> None:
    shape = {**SHAPES[kind], "to_world": moves(move), "flip_normals": is_flipped}
    scene = load(s=shape)
    assert_faces_are_what_rays_hit(scene, extract_triangles(scene))


@pytest.mark.parametrize("is_flipped", [False, True], ids=["normal", "flipped"])
@pytest.mark.parametrize("move", ["as it is", "mirrored"])
def test_mesh_files_keep_their_front(tmp_path: Any, move: str, is_flipped: bool) -> None:
    path = tmp_path / "tetrahedron.obj"
    path.write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", encoding="ascii"
    )
    shape = {
        "type": "obj",
        "filename": str(path),
        "to_world": moves(move),
        "flip_normals": is_flipped,
        "face_normals": True,
    }
    scene = load(s=shape)
    assert_faces_are_what_rays_hit(scene, extract_triangles(scene))


def in_order(vertices: np.ndarray) -> np.ndarray:
    """Triangles sorted by their corners, each turned so that its least corner comes first."""
    rounded = np.round(vertices, 4) + 0.0
    rows = []
    for triangle in rounded:
        first = min(range(3), key=lambda corner: tuple(triangle[corner]))
        rows.append(np.roll(triangle, -first, axis=0).ravel())
    ordered: np.ndarray = np.array(sorted(rows, key=tuple))
    return ordered


def groups() -> dict[str, SceneDict]:
    local = mi.ScalarTransform4f().translate([0.2, 0.0, 0.1]) @ turned((0, 1, 1), 20).scale(0.4)
    return {
        "box": {"type": "cube", "to_world": local},
        "ball": {"type": "sphere", "center": [0.5, 0.1, 0.0], "radius": 0.3},
    }


PLACES: dict[str, Callable[[], mi.ScalarAffineTransform4f]] = {
    "moved": lambda: mi.ScalarTransform4f().translate([3.0, 0.0, -1.0]),
    "turned": lambda: mi.ScalarTransform4f().translate([0.0, 4.0, 0.0]) @ turned((1, 2, 3), 33),
    "mirrored": lambda: mi.ScalarTransform4f().translate([0.0, 0.0, 5.0]).scale([1, -1, 1]),
    "stretched": lambda: mi.ScalarTransform4f().translate([-4.0, 0.0, 0.0]).scale([1, 2, 0.5]),
}


def instanced_and_direct() -> tuple[mi.Scene, list[np.ndarray]]:
    """Return a scene of instances of two groups, and the same triangles placed by hand."""
    parts: SceneDict = {}
    for name, shape in groups().items():
        parts[f"group_{name}"] = {"type": "shapegroup", "id": f"group_{name}", "shape": shape}
    expected = []
    for index, (place_name, place) in enumerate(PLACES.items()):
        name = ("box", "ball")[index % 2]
        parts[f"instance_{place_name}"] = {
            "type": "instance",
            "to_world": place(),
            "group": {"type": "ref", "id": f"group_{name}"},
        }
        (mesh,) = list_shapes(load(shape=groups()[name])).meshes
        matrix = np.array(place().matrix, dtype=np.float64)
        moved = mesh.positions @ matrix[:3, :3].T + matrix[:3, 3]
        faces = mesh.faces if np.linalg.det(matrix[:3, :3]) > 0.0 else mesh.faces[:, ::-1]
        expected.append(moved[faces])
    return load(**parts), expected


def test_instances_of_two_groups_equal_the_same_meshes_placed_directly() -> None:
    scene, expected = instanced_and_direct()
    found = extract_triangles(scene)
    assert not found.unsupported
    np.testing.assert_allclose(
        in_order(found.vertices), in_order(np.concatenate(expected)), atol=2e-4
    )


def test_fronts_of_instances_are_the_sides_that_rays_see() -> None:
    scene, _ = instanced_and_direct()
    found = extract_triangles(scene)
    # A stretched ball's normals are bent by its chords more than a round one's.
    chosen = [i for i, name in enumerate(found.shape_names) if "stretched" not in name]
    is_chosen = np.isin(found.shape_index, chosen)
    front = found.vertices[is_chosen]
    normal = found.normals[is_chosen]
    start = front.mean(axis=1) + 0.01 * normal
    ray = mi.Ray3f(
        mi.Point3f(np.ascontiguousarray(start.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(-normal.T, dtype=np.float32)),
    )
    si = scene.ray_intersect(ray)
    assert np.array(si.is_valid()).all()
    assert np.einsum("it,ti->t", np.array(si.n), normal).min() > 0.9


def test_two_groups_of_one_box_cannot_be_told_apart_and_are_named() -> None:
    parts: SceneDict = {
        f"g{i}": {"type": "shapegroup", "id": f"g{i}", "s": {"type": "cube"}} for i in range(2)
    }
    parts["seen"] = {"type": "rectangle"}
    parts["inst"] = {"type": "instance", "group": {"type": "ref", "id": "g0"}}
    found = extract_triangles(load(**parts))
    assert found.triangle_count == 2
    assert len(found.unsupported) == 1
    assert "2 shape groups fit its bounding box" in found.unsupported[0]


def curve_file(path: Any) -> str:
    path.write_text("0 0 0 0.1\n1 0 0 0.1\n2 1 0 0.1\n3 1 1 0.1\n4 0 1 0.1\n", encoding="ascii")
    return str(path)


def test_shapes_without_triangles_are_named(tmp_path: Any) -> None:
    distance = np.linalg.norm(np.indices((4, 4, 4)) - 1.5, axis=0) - 1.0
    grid = mi.TensorXf(distance[..., None].astype(np.float32))
    found = triangles_of(
        seen={"type": "rectangle"},
        curve={"type": "bsplinecurve", "filename": curve_file(tmp_path / "curve.txt")},
        lines={"type": "linearcurve", "filename": curve_file(tmp_path / "lines.txt")},
        field={"type": "sdfgrid", "grid": grid},
    )
    assert found.triangle_count == 2
    assert len(found.unsupported) == 3
    for name, kind in [("curve", "BSplineCurve"), ("lines", "LinearCurve"), ("field", "SDFGrid")]:
        assert any(f"'{name}' ({kind}): left out" in each for each in found.unsupported)
