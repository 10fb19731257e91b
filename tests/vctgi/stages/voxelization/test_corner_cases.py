"""Triangles that voxelizers get wrong: huge, tiny, edge-on, on faces, shared, closed, doubled."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Delaunay

from tests.vctgi.opacity_tables import (
    AREA_STEP,
    METHODS,
    ROUNDING,
    on_axis,
    seen_along,
    voxelize,
    window,
)
from tests.vctgi.twins.clipping import clipped_area
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.voxelization.opacity import Coverage

pytestmark = [
    pytest.mark.usefixtures("variant"),
    pytest.mark.parametrize("method", METHODS),
]

RESOLUTION = 8


def flat(corners: list[list[float]], depth: float) -> np.ndarray:
    """One triangle of corners (u, v) at one depth, facing up."""
    return np.array([[[u, v, depth] for u, v in corners]], float)


def front_slot(axis: int, *, faces_up: bool) -> int:
    """Slot that a flat triangle is met in: rays against its normal."""
    return 2 * axis + (1 if faces_up else 0)


@pytest.mark.parametrize("size", [1e2, 1e6, 1e9])
@pytest.mark.parametrize("axis", range(3))
def test_a_triangle_larger_than_all_levels_fills_one_layer(
    axis: int, size: float, method: Coverage
) -> None:
    corners = flat([[-size, -size], [2 * size, -size], [-size, 2 * size]], 3.5)
    slot = front_slot(axis, faces_up=True)
    layout = window(level_count=2)
    for table, level in zip(
        voxelize(on_axis(corners, axis), layout, method), layout.clip_levels, strict=True
    ):
        expected = np.zeros_like(table)
        layer = int(3.5 / level.voxel_size) - level.origin[axis]
        seen_along(expected, slot)[layer] = 1.0
        np.testing.assert_array_equal(table, expected)


@pytest.mark.parametrize("size", [1e2, 1e6])
def test_a_slanted_triangle_across_the_scene_leaves_no_hole(size: float, method: Coverage) -> None:
    rng = np.random.default_rng(6)
    met_count = 0
    for _ in range(6):
        corners = rng.normal(size=(3, 3))
        corners += 4.0 - corners.mean(axis=0)
        corners = 4.0 + size * (corners - 4.0)
        for table in voxelize(corners[None], window(), method):
            for slot in range(DIRECTION_COUNT):
                columns = seen_along(table, slot).sum(axis=0)
                # The plane leaves the window somewhere, where columns are empty or cut.
                expected = columns_that_meet(corners, slot, RESOLUTION)
                assert np.all(columns[expected] >= 1.0 - ROUNDING[method])
                met_count += int(np.count_nonzero(expected))
    assert met_count >= 6 * RESOLUTION**2


def columns_that_meet(corners: np.ndarray, slot: int, resolution: int) -> np.ndarray:
    """Columns [v, u] that a plane of corners crosses within the window, met from its front."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    axis = slot // 2
    u, v = (axis + 1) % 3, (axis + 2) % 3
    if (normal[axis] < 0.0) != (slot % 2 == 0):
        return np.zeros((resolution, resolution), bool)
    edge = np.arange(resolution + 1.0)
    at_v, at_u = np.meshgrid(edge, edge, indexing="ij")
    depth = (
        corners[0, axis]
        - (normal[u] * (at_u - corners[0, u]) + normal[v] * (at_v - corners[0, v])) / normal[axis]
    )
    is_inside = (depth > 0.01) & (depth < resolution - 0.01)
    whole: np.ndarray = is_inside[1:, 1:] & is_inside[:-1, 1:] & is_inside[1:, :-1]
    whole &= is_inside[:-1, :-1]
    return whole


def test_triangles_smaller_than_a_cell_cover_their_area_on_average(method: Coverage) -> None:
    resolution, size = 32, 0.05
    rng = np.random.default_rng(7)
    places = np.stack(np.meshgrid(*[np.arange(resolution)] * 2), axis=-1).reshape(-1, 1, 2)
    corners = np.full((len(places), 3, 3), 3.5)
    inner = rng.uniform(size, 1.0 - size, places.shape) + rng.uniform(-size, size, (1, 3, 2))
    corners[..., :2] = places + inner
    table = voxelize(corners, window(resolution), method)[0]
    area = sum(clipped_area(c[:, :2], np.zeros(2), np.full(2, 1e3)) for c in corners)
    found = table[4:].sum()
    assert table.sum() == found
    # Each face is hit or missed by whole steps: the variance of a Bernoulli count.
    deviation = np.sqrt(AREA_STEP[method] * area)
    assert abs(found - area) <= 5.0 * deviation + len(corners) * ROUNDING[method]


@pytest.mark.parametrize("axis", range(3))
def test_edge_on_triangles_leave_the_slots_of_their_axis_empty(axis: int, method: Coverage) -> None:
    # In the plane u + v = 8: seen along u and v, and edge-on along the axis.
    corners = np.array([[[1, 7, 1], [7, 1, 1], [4, 4, 7]]], float)
    table = voxelize(on_axis(corners, axis), window(), method)[0]
    is_met = [bool(table[slot].any()) for slot in range(DIRECTION_COUNT)]
    assert is_met[2 * axis : 2 * axis + 2] == [False, False]
    assert sum(is_met) == 2


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("faces_up", [True, False])
@pytest.mark.parametrize("rounding", [0.0, 1e-9, -1e-9])
def test_a_triangle_on_a_voxel_face_fills_the_layer_behind_it(
    axis: int, faces_up: bool, rounding: float, method: Coverage
) -> None:
    corners = flat([[-99, -99], [200, -99], [-99, 200]], 4.0 + rounding)
    corners = corners if faces_up else corners[:, ::-1]
    table = voxelize(on_axis(corners, axis), window(), method)[0]
    expected = np.zeros_like(table)
    seen_along(expected, front_slot(axis, faces_up=faces_up))[3 if faces_up else 4] = 1.0
    np.testing.assert_array_equal(table, expected)


def fan(outline: np.ndarray, centre: np.ndarray | None = None) -> np.ndarray:
    """Triangles of a convex outline [corner, 2], around a point or its first corner."""
    if centre is None:
        return np.array([[outline[0], b, c] for b, c in itertools.pairwise(outline[1:])])
    return np.array(
        [[centre, b, c] for b, c in zip(outline, np.roll(outline, -1, axis=0), strict=True)]
    )


def in_plane(triangles: np.ndarray, slope: tuple[float, float]) -> np.ndarray:
    """Corners (u, v) lifted into a plane, (u, v, 4 + slope . (u - 4, v - 4))."""
    depth = 4.0 + (triangles - 4.0) @ np.array(slope)
    return np.concatenate([triangles, depth[..., None]], axis=-1)


SLOPES = [(0.0, 0.0), (0.25, 0.0), (0.37, -0.81)]


@pytest.mark.parametrize("slope", SLOPES)
@pytest.mark.parametrize("axis", range(3))
def test_every_triangulation_of_a_polygon_covers_the_same(
    axis: int, slope: tuple[float, float], method: Coverage
) -> None:
    rng = np.random.default_rng(11)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 11))
    outline = 4.0 + 3.6 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    inner = 4.0 + rng.uniform(-1.0, 1.0, (40, 2))
    points = np.concatenate([outline, inner])
    meshes = [fan(outline), fan(np.roll(outline, 4, axis=0)), fan(outline, inner[0])]
    meshes.append(upward(points[Delaunay(points).simplices]))
    found = [voxelize(on_axis(in_plane(m, slope), axis), window(), method)[0] for m in meshes]
    assert found[0].any()
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0.0, atol=ROUNDING[method])


def upward(triangles: np.ndarray) -> np.ndarray:
    """Triangles [triangle, corner, 2], wound counter-clockwise."""
    a, b, c = (triangles[:, corner] for corner in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    wound: np.ndarray = np.where((turn < 0.0)[:, None, None], triangles[:, ::-1], triangles)
    return wound


@settings(max_examples=20)
@given(
    cuts=st.tuples(*[st.lists(st.integers(1, 63), max_size=6)] * 2),
    slope=st.sampled_from([(0.0, 0.0), (0.5, 0.25), (1.0, -0.125)]),
    seed=st.integers(0, 99),
)
def test_a_cut_up_square_covers_what_the_square_does(
    method: Coverage, cuts: tuple[list[int], list[int]], slope: tuple[float, float], seed: int
) -> None:
    # Cuts on eighths of a voxel: edges run along and through the centres of cells.
    u, v = (np.array(sorted({4, *c, 60})) / 8.0 for c in cuts)
    rng = np.random.default_rng(seed)
    pieces = []
    for (u0, u1), (v0, v1) in itertools.product(itertools.pairwise(u), itertools.pairwise(v)):
        quad = np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]])
        pieces.append(fan(np.roll(quad, int(rng.integers(2)), axis=0)))
    whole = fan(np.array([[u[0], v[0]], [u[-1], v[0]], [u[-1], v[-1]], [u[0], v[-1]]]))
    found, expected = (
        voxelize(in_plane(triangles, slope), window(), method)[0]
        for triangles in (np.concatenate(pieces), whole)
    )
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING[method])


def cube() -> np.ndarray:
    """Twelve triangles of a cube, neither aligned with voxels nor turned."""
    return hull(np.array([[x, y, z] for x in (1.3, 6.6) for y in (1.3, 6.6) for z in (1.3, 6.6)]))


def sphere() -> np.ndarray:
    points = np.random.default_rng(12).normal(size=(150, 3))
    return hull(4.0 + 3.3 * points / np.linalg.norm(points, axis=1, keepdims=True))


def hull(points: np.ndarray) -> np.ndarray:
    """Triangles [triangle, corner, 3] of a convex hull, facing outwards."""
    found = ConvexHull(points)
    triangles = points[found.simplices]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    is_inward = np.sum(normal * found.equations[:, :3], axis=1) < 0.0
    wound: np.ndarray = np.where(is_inward[:, None, None], triangles[:, ::-1], triangles)
    return wound


@pytest.mark.parametrize("is_inside_out", [False, True])
@pytest.mark.parametrize("solid", [cube, sphere])
def test_no_ray_passes_through_a_closed_mesh(
    solid: object, is_inside_out: bool, method: Coverage
) -> None:
    assert callable(solid)
    triangles = solid()
    table = voxelize(triangles[:, ::-1] if is_inside_out else triangles, window(), method)[0]
    for slot in range(DIRECTION_COUNT):
        columns = seen_along(table, slot).sum(axis=0)
        area = silhouette(triangles, slot)
        is_whole = area >= 1.0 - 1e-9
        assert np.count_nonzero(is_whole) >= RESOLUTION
        assert np.all(columns[is_whole] >= 1.0 - ROUNDING[method])
        assert not columns[area == 0.0].any()


def silhouette(triangles: np.ndarray, slot: int) -> np.ndarray:
    """Area [v, u] of each column's face that the side of a convex solid facing a slot covers."""
    axis = slot // 2
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    is_met = (normal[:, axis] < 0.0) == (slot % 2 == 0)
    projected = triangles[is_met][:, :, [(axis + 1) % 3, (axis + 2) % 3]]
    area = np.zeros((RESOLUTION, RESOLUTION))
    for each in projected:
        first = np.floor(each.min(axis=0)).astype(int)
        last = np.floor(each.max(axis=0)).astype(int)
        for u, v in itertools.product(*map(range, first, last + 1)):
            low = np.array([u, v], float)
            area[v, u] += clipped_area(each, low, low + 1.0)
    return area


def test_copies_count_once_in_cells_and_add_as_areas(method: Coverage) -> None:
    once = voxelize(sphere(), window(), method)[0]
    twice = voxelize(np.concatenate([sphere(), sphere()[:, [1, 2, 0]]]), window(), method)[0]
    expected = np.minimum(2.0 * once, 1.0) if method == "analytic" else once
    np.testing.assert_allclose(twice, expected, rtol=0.0, atol=ROUNDING[method])


def test_first_corner_does_not_matter_and_winding_chooses_the_slot(method: Coverage) -> None:
    corners = np.random.default_rng(13).uniform(0.0, 8.0, (20, 3, 3))
    table = voxelize(corners, window(), method)[0]
    rolled = voxelize(corners[:, [1, 2, 0]], window(), method)[0]
    np.testing.assert_allclose(rolled, table, rtol=0.0, atol=ROUNDING[method])
    for each in corners:
        one, other = (voxelize(c[None], window(), method)[0] for c in (each, each[::-1]))
        for axis in range(3):
            met = [bool(t[2 * axis + side].any()) for t in (one, other) for side in range(2)]
            assert met in ([True, False, False, True], [False, True, True, False], [False] * 4)


def test_many_sheets_on_one_edge_cover_as_if_each_stood_alone(method: Coverage) -> None:
    # Five half-planes that share the edge u = v = 4: no manifold.
    angle = np.array([0.1, 1.2, 2.5, 3.9, 5.1])
    sheets = []
    for c, s in zip(np.cos(angle), np.sin(angle), strict=True):
        far = np.array([4.0 + 3.0 * c, 4.0 + 3.0 * s])
        sheets.append([[4.0, 4.0, 1.0], [*far, 1.0], [*far, 7.0]])
        sheets.append([[4.0, 4.0, 1.0], [*far, 7.0], [4.0, 4.0, 7.0]])
    alone = [voxelize(np.array([each]), window(), method)[0] for each in sheets]
    together = voxelize(np.array(sheets), window(), method)[0]
    most, summed = np.max(alone, axis=0), np.sum(alone, axis=0)
    assert np.all(together >= most - ROUNDING[method])
    assert np.all(together <= np.minimum(summed, 1.0) + ROUNDING[method])
