"""What the slots know of their surfaces: the plane's own place, normal and albedo."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import camera, diffuse, load, oblique, rotation_matrix
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.slot_surfaces import SlotSurfaces
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.scene.materials import describe_material
from vctgi.scene.surfaces import select_surfaces
from vctgi.scene.triangles import extract_triangles
from vctgi.stages.slot_surfaces.samples import sample_surfaces
from vctgi.stages.slot_surfaces.slots import SlotSurfacesConfig, describe_slots
from vctgi.stages.voxelization.opacity import voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

ALBEDO = 0.3

STEP = 1e-5
"""World units: the fixed-point sums of the points' offsets, and single precision."""


def described(
    is_turned: bool, level_count: int = 1, **material: Any
) -> tuple[list[SlotSurfaces], OpacityClipmap]:
    """Return the slots of the square from -1 to 1 that faces +z before it is turned."""
    outer: Any = oblique() if is_turned else mi.ScalarTransform4f()
    bsdf = material.get("bsdf", diffuse(ALBEDO))
    scene = load(
        square={"type": "rectangle", "to_world": outer, "bsdf": bsdf},
        sensor=camera([0, 0, 3], [0, 0, 0], outer=outer),
    )
    triangles = extract_triangles(scene)
    materials = [describe_material(each) for each in triangles.bsdfs]
    surfaces = select_surfaces(scene, scene.sensors()[0], triangles, materials)
    layout = lay_out_clipmap(
        (0.01, 0.02, 0.03), finest_voxel_size=0.15, level_count=level_count, resolution=16
    )
    opacity = voxelize_opacity(surfaces, layout)
    return describe_slots(scene, surfaces, opacity), opacity


@pytest.mark.parametrize("is_turned", [False, True], ids=["axis", "turned"])
def test_slots_know_the_plane_that_they_hold(is_turned: bool) -> None:
    (slots,), _ = described(is_turned)
    normal = (rotation_matrix(oblique()) if is_turned else np.eye(3)) @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(np.array(slots.normal).T @ normal, 1.0, rtol=STEP)
    np.testing.assert_allclose(np.array(slots.position).T @ normal, 0.0, atol=STEP)
    np.testing.assert_allclose(np.array(slots.albedo), ALBEDO, rtol=1e-4)
    assert slots.unknown_share == 0.0


def test_every_slot_with_opacity_is_named_once() -> None:
    (slots,), opacity = described(is_turned=True)
    expected = np.flatnonzero(np.array(opacity.levels[0]) > 0.0)
    np.testing.assert_array_equal(np.array(slots.index), expected)
    np.testing.assert_array_equal(np.array(slots.opacity), np.array(opacity.levels[0])[expected])


def test_what_finer_voxels_replace_is_left_out() -> None:
    finer, coarser = described(is_turned=True, level_count=2)[0]
    assert finer.count > 0
    assert np.abs(np.array(coarser.position)).max() > 1.0 or coarser.count == 0


def test_sums_do_not_depend_on_the_run() -> None:
    first, second = (described(is_turned=True)[0][0] for _ in range(2))
    for name in ("position", "normal", "albedo"):
        np.testing.assert_array_equal(
            np.array(getattr(first, name)), np.array(getattr(second, name))
        )


def test_points_do_not_depend_on_the_order_of_triangles() -> None:
    level = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=0.2, level_count=1, resolution=16
    ).levels[0]
    triangles = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3, 3))
    forwards, backwards = (
        sample_surfaces(each, level, 8.0)[0] for each in (triangles, triangles[::-1])
    )
    as_rows = [each[np.lexsort(each.T)] for each in (forwards, backwards)]
    np.testing.assert_array_equal(as_rows[0], as_rows[1])


def test_rough_surfaces_reflect_no_more_than_they_get() -> None:
    metal = {"type": "roughconductor", "material": "none", "alpha": 0.4}
    (slots,), _ = described(is_turned=False, bsdf=metal)
    albedo = np.array(slots.albedo)
    assert albedo.max() <= 1.0
    assert albedo.mean() > 0.8, "a mirror without losses, less what single scattering loses"


def test_an_empty_level_has_no_slots() -> None:
    scene = load(square={"type": "rectangle"}, sensor=camera([0, 0, 3], [0, 0, 0]))
    triangles = extract_triangles(scene)
    materials = [describe_material(each) for each in triangles.bsdfs]
    surfaces = select_surfaces(scene, scene.sensors()[0], triangles, materials)
    layout = lay_out_clipmap((50.0, 0, 0), finest_voxel_size=0.1, level_count=1, resolution=8)
    (slots,) = describe_slots(scene, surfaces, voxelize_opacity(surfaces, layout))
    assert slots.count == 0
    assert dr.width(slots.position) == 0


@pytest.mark.parametrize("count", [0.0, -1.0, float("nan")])
def test_no_points_at_all_are_refused(count: float) -> None:
    with pytest.raises(ValueError, match="samples_per_face"):
        SlotSurfacesConfig(samples_per_face=count)
