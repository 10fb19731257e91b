"""Exact light: opacity times the mean radiance of what is in a slot, no more and no less."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import pytest

from experiments.studies import scenes
from experiments.studies.cornell import CornellBox, Receivers, path_traced
from experiments.studies.exact_voxels import (
    exact_emittance,
    grid_points,
    lay_out_window,
    scene_of,
    surfaces_in,
)
from experiments.studies.tracers import constant_radiance
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.stages.voxelization.opacity import voxelize_opacity
from vctgi.stages.voxelization.triangles import unit_normals

pytestmark = pytest.mark.usefixtures("variant")

SINGLE_PRECISION = 1e-6

ALBEDO, SKY = 0.5, 2.0

ONE_SAMPLE = 1.29
"""Relative standard deviation of one sample of an even sky, uniform over the sphere, seen by a
floor: sqrt(16 / 6 - 1)."""


def opacity_of(scene: scenes.ShiningScene) -> OpacityClipmap:
    surfaces = surfaces_in(scene_of(scene.triangles))
    return voxelize_opacity(surfaces, lay_out_window(scene.triangles))


@pytest.mark.parametrize("is_turned", [False, True])
def test_one_radiance_gives_opacity_times_it_everywhere(is_turned: bool) -> None:
    scene = scenes.white_furnace(2, seed=1)
    scene = scene.turned() if is_turned else scene
    opacity = opacity_of(scene)
    lit = exact_emittance(opacity, scene.triangles, constant_radiance(3.0 * scene.radiance))
    alpha = np.array(opacity.levels[0])
    np.testing.assert_allclose(
        np.array(lit.levels[0])[0], 3.0 * alpha, rtol=SINGLE_PRECISION, atol=SINGLE_PRECISION
    )


def test_a_slot_of_two_surfaces_holds_their_mean() -> None:
    # A floor whose left half is dark, the seam at 0.3 of a voxel.
    scene = scenes.parallel_squares(1.0, 2, seed=1)
    voxel_size = lay_out_window(scene.triangles).finest_voxel_size
    opacity = opacity_of(scene)
    seam = 0.25 * voxel_size

    def half_dark(points: np.ndarray, _normals: np.ndarray, _owner: np.ndarray) -> np.ndarray:
        bright = np.where(points[:, :1] > seam, 1.0, 0.0)
        return np.repeat(bright, 3, axis=1)

    lit = exact_emittance(opacity, scene.triangles, half_dark)
    alpha = np.array(opacity.levels[0])
    mean = np.array(lit.levels[0])[0][alpha > 0.0] / alpha[alpha > 0.0]
    expected = np.array([0.0, 0.75, 1.0])
    assert np.abs(mean[:, None] - expected).min(axis=1).max() < SINGLE_PRECISION
    assert (np.abs(mean - 0.75) < SINGLE_PRECISION).any()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_points_stand_for_equal_projected_areas(axis: int) -> None:
    scene = scenes.white_furnace(2, seed=1).turned()
    normals = unit_normals(scene.triangles)
    spacing = 0.02
    points, owner = grid_points(scene.triangles, normals, axis, spacing)
    # Each face of the box is a square of area 4, in two triangles.
    projected = 2.0 * np.abs(normals[:, axis])
    found = np.bincount(owner, minlength=len(projected)) * spacing**2
    # Centres in a triangle count its area to within its outline.
    assert np.abs(found - projected).max() < 4.0 * 2.0 * math.sqrt(2.0) * spacing
    along = np.einsum("ij,ij->i", points - scene.triangles[owner, 0], normals[owner])
    assert np.abs(along).max() < SINGLE_PRECISION


def test_opacity_without_surfaces_is_refused() -> None:
    scene = scenes.parallel_squares(1.0, 2, seed=1)
    with pytest.raises(ValueError, match="no point of a surface falls into"):
        exact_emittance(
            opacity_of(scene), scene.triangles[:2], constant_radiance(scene.radiance[:2])
        )


def test_paths_and_surfaces_agree_under_an_even_sky() -> None:
    # A floor without end under a sky of one radiance sends out albedo times it everywhere, and a
    # point that looks down at it receives just that.
    upwards = mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale(500.0)
    scene: mi.Scene = mi.load_dict(
        {
            "type": "scene",
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": SKY}},
            "floor": {
                "type": "rectangle",
                "to_world": upwards,
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": ALBEDO}},
            },
        }
    )
    room = CornellBox(scene=scene, triangles=np.zeros((0, 3, 3)))
    edge = np.linspace(-1.0, 1.0, 16)
    points = np.array([[x, 0.0, z] for x in edge for z in edge])
    up = np.tile([0.0, 1.0, 0.0], (len(points), 1))
    above = Receivers(points=points + 0.5 * up, normals=-up)
    first, second = (path_traced(room, above, 1024, seed) for seed in (1, 2))
    assert not np.array_equal(first, second)
    for half in (first, second):
        assert half.mean() == pytest.approx(ALBEDO * SKY, rel=4.0 * ONE_SAMPLE / (16 * 32))
    leaving = room.radiance(points, up, np.zeros(len(points)))
    assert leaving.mean() == pytest.approx(ALBEDO * SKY, rel=4.0 * ONE_SAMPLE / (16 * 2))
