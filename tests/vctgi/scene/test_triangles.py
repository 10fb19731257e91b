"""The scene as triangles: nothing is dropped or mended in silence."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import diffuse, load, room
from vctgi.errors import SceneError
from vctgi.scene.triangles import extract_triangles, is_degenerate

pytestmark = pytest.mark.usefixtures("variant")


def mesh(vertices: list[list[float]], faces: list[list[int]], name: str = "thing") -> mi.Mesh:
    made = mi.Mesh(name, len(vertices), len(faces))
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mi.Float(np.array(vertices, np.float32).ravel())
    parameters["faces"] = mi.UInt32(np.array(faces, np.uint32).ravel())
    parameters.update()
    return made


QUAD = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]


def test_faces_keep_their_vertices_and_their_materials() -> None:
    scene = load(a={"type": "cube", "bsdf": diffuse(0.2)}, b={"type": "rectangle"})
    found = extract_triangles(scene)
    assert found.triangle_count == 14
    counts = np.bincount(found.shape_index).tolist()
    assert dict(zip(found.shape_names, counts, strict=True)) == {"a": 12, "b": 2}
    # Both shapes have a BSDF; shapes that share one share its index.
    assert len(found.bsdfs) == 2
    np.testing.assert_array_equal(found.bounds, [[-1, -1, -1], [1, 1, 1]])


def test_shapes_that_share_a_bsdf_share_its_index() -> None:
    shared = mi.load_dict(diffuse(0.3))
    found = extract_triangles(load(**room(bsdf=shared)))
    assert len(found.bsdfs) == 1
    assert set(found.bsdf_index) == {0}


def test_zero_area_triangles_are_counted_and_left_out() -> None:
    faces = [[0, 1, 2], [0, 0, 1], [0, 2, 3], [1, 1, 1]]
    found = extract_triangles(load(thing=mesh(QUAD, faces)))
    assert found.triangle_count == 2
    assert list(found.degenerate_counts.values()) == [2]
    np.testing.assert_array_equal(found.kept, [0, -1, 1, -1])
    assert np.isfinite(found.normals).all()


def test_thin_triangles_are_not_degenerate() -> None:
    thin = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-5, 0.0]]])
    assert not is_degenerate(thin).any()
    line = np.array([[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0]]])
    assert is_degenerate(line).all()


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_vertices_that_are_not_finite_are_refused(value: float) -> None:
    broken = [*QUAD[:3], [0.0, value, 0.0]]
    scene = load(thing=mesh(broken, [[0, 1, 2], [0, 2, 3]]))
    with pytest.raises(SceneError, match=r"1 face corners are NaN or infinite.*thing"):
        extract_triangles(scene)


def test_scene_without_triangles_is_refused() -> None:
    with pytest.raises(SceneError, match="no geometry"):
        extract_triangles(load(light={"type": "constant"}))
    with pytest.raises(SceneError, match="every triangle has zero area"):
        extract_triangles(load(thing=mesh(QUAD, [[0, 0, 1]])))


def test_texture_coordinates_come_along() -> None:
    found = extract_triangles(load(a={"type": "rectangle"}))
    corners: Any = found.vertices.reshape(-1, 3)
    np.testing.assert_allclose(found.uv.reshape(-1, 2), 0.5 * (corners[:, :2] + 1.0), atol=1e-6)
