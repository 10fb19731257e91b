"""Views of voxels: a square is exactly its voxels; a slanted plane shows nearly its own normal."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.debug.straight_rays import one_level, rays_of, rays_through_columns, voxels_with
from tests.vctgi.hand_made_volumes import emittance_of
from tests.vctgi.small_scenes import camera, color, load
from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.slots import SlotRule
from vctgi.debug.camera import PixelRays, pixel_rays
from vctgi.debug.surface_albedo import VoxelAlbedo, voxel_albedo
from vctgi.debug.voxel_views import EDGE_SHADE, VoxelView, view_voxels
from vctgi.debug.voxels import LevelVoxels, level_voxels
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.scene.triangles import extract_triangles
from vctgi.stages.slot_surfaces.samples import split_to_window
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig, voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

ROUNDING = 1e-6
"""Single precision, for numbers of order 1 that a few operations made."""

MEAN_NORMAL_DEGREES = {0.0: 2.0, 1.0: 6.0}
"""Of a slanted plane over all its visible voxels, by thickness. As thin as it is, its projected
areas are proportional to its normal, up to the 64ths of a face that coverage is counted in. Made
thicker, each axis fills voxels of its own behind the plane, and a ray sees the first of them."""

VOXEL_NORMAL_DEGREES = 55.0
"""Of a single voxel: at the least opacity that is shown it has a corner of the plane, which may
cover one face alone."""


def square(low: tuple[float, float], high: tuple[float, float], z: float) -> np.ndarray:
    """Two triangles [triangle, corner, 3] across z that face -z."""
    (x0, y0), (x1, y1) = low, high
    corners = np.array([[x0, y0, z], [x0, y1, z], [x1, y1, z], [x1, y0, z]])
    return corners[[[0, 1, 2], [0, 2, 3]]]


def voxelized(
    vertices: np.ndarray, layout: ClipmapLayout, radiance: list[float], thickness: float = 1.0
) -> LevelVoxels:
    """Voxels of one-sided triangles that all have one radiance."""
    config = OpacityVoxelizationConfig(slots=SlotRule(thickness_voxels=thickness), is_complete=True)
    opacity = voxelize_opacity(opaque_surfaces(vertices), layout, config)
    alphas = [
        np.array(a).reshape(DIRECTION_COUNT, *(each.resolution,) * 3)
        for a, each in zip(opacity.levels, layout.levels, strict=True)
    ]
    emittance = emittance_of(layout, [a[..., None] * np.array(radiance) for a in alphas])
    return level_voxels(opacity, 0, emittance)


def view(voxels: LevelVoxels, rays: PixelRays, albedo: VoxelAlbedo | None = None) -> VoxelView:
    nothing = dr.zeros(mi.Float, dr.width(voxels.opacity))
    black = dr.zeros(mi.Color3f, dr.width(nothing))
    return view_voxels(voxels, rays, albedo or VoxelAlbedo(black, nothing))


def degrees(normals: np.ndarray, expected: np.ndarray) -> np.ndarray:
    angles: np.ndarray = np.degrees(np.arccos(np.clip(normals @ expected, -1.0, 1.0)))
    return angles


def test_an_axis_aligned_square_is_its_silhouette() -> None:
    layout = one_level()
    voxels = voxelized(square((-1.0, -0.5), (1.0, 1.5), 0.25), layout, [3.0, 2.0, 1.0])
    seen = view(voxels, rays_through_columns(layout.levels[0]))
    expected = np.zeros((8, 8), bool)
    expected[3:7, 2:6] = True
    np.testing.assert_array_equal(seen.is_hit, expected)
    np.testing.assert_allclose(seen.opacity, expected, rtol=ROUNDING)
    np.testing.assert_array_equal(seen.normal, expected[..., None] * np.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(
        seen.radiance, expected[..., None] * np.array([3.0, 2.0, 1.0]), rtol=ROUNDING
    )
    assert np.isnan(seen.albedo[expected]).all(), "no sample was given"
    assert not seen.albedo[~expected].any()


def test_a_half_covered_voxel_has_half_the_opacity_and_all_the_radiance() -> None:
    layout = one_level()
    voxels = voxelized(square((0.0, 0.0), (0.25, 0.5), 0.25), layout, [3.0, 2.0, 1.0])
    seen = view(voxels, rays_through_columns(layout.levels[0]))
    assert seen.is_hit.sum() == 1
    assert seen.opacity[4, 4] == pytest.approx(0.5, rel=ROUNDING)
    np.testing.assert_allclose(seen.radiance[4, 4], [3.0, 2.0, 1.0], rtol=ROUNDING)


def test_a_square_shows_nothing_from_behind() -> None:
    layout = one_level()
    voxels = voxelized(square((-1.0, -0.5), (1.0, 1.5), 0.25), layout, [3.0, 2.0, 1.0])
    seen = view(voxels, rays_through_columns(layout.levels[0], towards=-1))
    for picture in (seen.is_hit, seen.opacity, seen.radiance, seen.normal, seen.depth, seen.albedo):
        assert not picture.any()


@pytest.mark.parametrize("thickness", MEAN_NORMAL_DEGREES)
@pytest.mark.parametrize("normal", [(-1.0, -2.0, -3.0), (2.0, -1.0, -1.5), (0.0, 1.0, -1.0)])
def test_a_slanted_plane_shows_its_normal(
    normal: tuple[float, float, float], thickness: float
) -> None:
    unit = np.array(normal) / np.linalg.norm(normal)
    across = np.cross(unit, [0.3, 0.8, 0.1])
    across /= np.linalg.norm(across)
    up = np.cross(unit, across)
    corners = np.array([a * across + b * up for a, b in ((-9, -9), (9, -9), (9, 9), (-9, 9))])
    triangles = corners[[[0, 1, 2], [0, 2, 3]]]
    assert np.cross(triangles[0, 1] - triangles[0, 0], triangles[0, 2] - triangles[0, 0]) @ unit > 0
    layout = one_level()
    voxels = voxelized(triangles, layout, [1.0] * 3, thickness)
    seen = view(voxels, rays_through_columns(layout.levels[0]))
    normals = seen.normal[seen.is_hit]
    assert len(normals) > 30
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=ROUNDING)
    mean = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    assert degrees(mean, unit) < MEAN_NORMAL_DEGREES[thickness]
    assert degrees(normals, unit).max() < VOXEL_NORMAL_DEGREES
    np.testing.assert_allclose(seen.radiance[seen.is_hit], 1.0, rtol=ROUNDING)


def test_a_sheet_of_two_sides_shows_the_side_that_the_ray_meets() -> None:
    layout = one_level()
    both = [((0, 0, 0), slot, 0.5, [1.0] * 3) for slot in (4, 5)]
    for towards in (1, -1):
        rays = rays_through_columns(layout.levels[0], towards)
        seen = view(voxels_with(layout, both), rays)
        assert seen.is_hit.sum() == 1
        np.testing.assert_array_equal(seen.normal[seen.is_hit], [[0.0, 0.0, -towards]])


def test_the_albedo_of_a_voxel_is_that_of_its_surface() -> None:
    red, green = color(0.8, 0.25, 0.0625), color(0.125, 0.5, 0.25)
    scene = load(
        sheet={
            "type": "rectangle",
            "bsdf": {
                "type": "twosided",
                "first": {"type": "diffuse", "reflectance": green},
                "second": {"type": "diffuse", "reflectance": red},
            },
        }
    )
    triangles = extract_triangles(scene)
    layout = one_level()
    front, back = triangles.vertices, triangles.vertices[:, ::-1]
    surfaces = opaque_surfaces(np.concatenate([front, back]))
    voxels = level_voxels(voxelize_opacity(surfaces, layout), 0)
    albedo = voxel_albedo(scene, surfaces, voxels)
    for towards, expected in ((1, [0.8, 0.25, 0.0625]), (-1, [0.125, 0.5, 0.25])):
        seen = view(voxels, rays_through_columns(layout.levels[0], towards), albedo)
        assert seen.is_hit.sum() == 16
        np.testing.assert_allclose(seen.albedo[seen.is_hit], np.tile(expected, (16, 1)), rtol=1e-5)


def test_splitting_triangles_keeps_their_area() -> None:
    layout = one_level()
    whole = square((-1.5, -1.0), (1.0, 1.5), 0.0)
    parts = split_to_window(whole, layout.levels[0])
    np.testing.assert_array_equal(parts, whole, "short enough already")
    large = split_to_window(400.0 * whole, layout.levels[0])
    assert np.abs(large).max() < 20.0, "what lies outside the window is left out"
    sides = np.linalg.norm(np.cross(large[:, 1] - large[:, 0], large[:, 2] - large[:, 0]), axis=1)
    assert 0.5 * sides.sum() >= 4.0**2, "the window is covered"
    assert len(split_to_window(whole + 50.0, layout.levels[0])) == 0


def test_lines_are_drawn_along_the_edges_of_voxels_only() -> None:
    layout = one_level()
    voxels = voxelized(square((-2.0, -2.0), (2.0, 2.0), 0.25), layout, [1.0] * 3)
    steps = (np.arange(160) + 0.5) / 40.0 - 2.0
    x, y = np.meshgrid(steps, steps)
    target = np.stack([x, y, np.zeros_like(x)], axis=-1)
    eye = np.broadcast_to([0.0, 0.0, -40.0], target.shape)
    seen = view(voxels, rays_of(eye, target - eye))
    assert seen.is_hit.all()
    from_line = np.abs((steps + 0.25) % 0.5 - 0.25)
    is_near = np.minimum(from_line[:, None], from_line[None, :]) < 0.02
    is_dark = seen.shade < 1.0
    assert is_dark[is_near].mean() > 0.9
    assert not is_dark[~is_near].any()
    np.testing.assert_allclose(seen.shade[is_dark], EDGE_SHADE, rtol=ROUNDING)


def test_rays_go_through_pixel_centres_row_by_row() -> None:
    scene = load(sheet={"type": "rectangle"}, sensor=camera([0, 0, 5], [0, 0, 0], size=8))
    rays = pixel_rays(scene.sensors()[0])
    direction = rays.picture(rays.direction)
    assert direction.shape == (8, 8, 3)
    # The camera looks along -z with +x to the left.
    assert (np.diff(direction[..., 0], axis=1) < 0.0).all() or (
        np.diff(direction[..., 0], axis=1) > 0.0
    ).all()
    assert (np.diff(direction[..., 1], axis=0) < 0.0).all()
    np.testing.assert_allclose(direction.mean(axis=(0, 1))[:2], 0.0, atol=ROUNDING)
    small = pixel_rays(scene.sensors()[0], longest=4)
    assert (small.width, small.height) == (4, 4)
    assert small.pixel_angle == pytest.approx(2.0 * rays.pixel_angle, rel=0.1)
