"""Diffuse cones: the gain of every set, their rotation, and sets that belong to the world."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from experiments.studies.peers.cone_sets import DC_TOLERANCE, glowing_fog, traced_gain
from experiments.studies.peers.harmonics import even_normals
from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import VoxelVolume, pack_volume
from vctgi.maths.peer_cones import PEER_CONE_SETS, peer_cone_set
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, trace_diffuse
from vctgi.stages.cone_tracing.march import ConeMarchConfig

pytestmark = pytest.mark.usefixtures("variant")

POINT_COUNT = 40

STILL = DiffuseConesConfig(cone_count=6, is_jittered=False, rotation="fixed")


def speckled() -> VoxelVolume:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=1, resolution=16)
    alphas, colors = random_values(layout, seed=3, empty_share=0.8)
    return pack_volume(opacity_of(layout, alphas), emittance_of(layout, colors))


def gathered(volume: VoxelVolume, config: DiffuseConesConfig) -> np.ndarray:
    """E / pi [rgb, point] of points that differ in their number alone."""
    normals = np.repeat(even_normals(3)[:1], POINT_COUNT, axis=0)
    at = white_receivers(np.full((POINT_COUNT, 3), 0.1), normals)
    return np.array(trace_diffuse(at, volume, config))


@pytest.mark.parametrize("name", PEER_CONE_SETS)
def test_a_constant_environment_gives_every_surface_the_same(name: str) -> None:
    np.testing.assert_allclose(traced_gain(glowing_fog(), name), 1.0, atol=DC_TOLERANCE)


@pytest.mark.parametrize("count", [1, 5, 23, 64])
def test_sets_of_any_count_trace_a_gain_of_one(count: int) -> None:
    config = replace(STILL, cone_count=count, march=ConeMarchConfig(min_transmittance=0.0))
    found = gathered(glowing_fog(), config)
    np.testing.assert_allclose(found / found[0, 0], 1.0, atol=DC_TOLERANCE)
    np.testing.assert_allclose(found, 2.0, rtol=DC_TOLERANCE)


def test_fixed_cones_are_alike_and_turned_ones_differ_by_pixel() -> None:
    volume = speckled()
    still = gathered(volume, STILL)
    np.testing.assert_array_equal(still, np.repeat(still[:, :1], POINT_COUNT, axis=1))
    turned = gathered(volume, replace(STILL, rotation="pixel"))
    assert len(np.unique(turned[0])) == POINT_COUNT


def test_cones_of_a_frame_turn_together() -> None:
    volume = speckled()
    frames = [gathered(volume, replace(STILL, rotation="frame", frame=n)) for n in range(3)]
    for found in frames:
        np.testing.assert_array_equal(found, np.repeat(found[:, :1], POINT_COUNT, axis=1))
    assert len({float(found[0, 0]) for found in frames}) == len(frames)


def test_gain_scales_what_is_gathered() -> None:
    volume = speckled()
    once, thrice = (gathered(volume, replace(STILL, gain=gain)) for gain in (1.0, 3.0))
    np.testing.assert_allclose(thrice, 3.0 * once, rtol=1e-6)


def test_an_offset_along_the_normal_moves_the_start() -> None:
    volume = speckled()
    normal = even_normals(3)[:1]
    lifted = replace(STILL, normal_offset_voxels=2.0)
    above = white_receivers(np.full((1, 3), 0.1) + 2.0 * 0.5 * normal, normal)
    np.testing.assert_allclose(
        gathered(volume, lifted)[:, 0],
        np.array(trace_diffuse(above, volume, STILL))[:, 0],
        rtol=1e-4,
    )


def test_cones_of_the_world_see_the_same_in_a_mirrored_world() -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=1, resolution=16)
    alphas, colors = random_values(layout, seed=5, empty_share=0.8)
    mirrored = [[v[[1, 0, 2, 3, 4, 5], :, :, ::-1] for v in values] for values in (alphas, colors)]
    config = DiffuseConesConfig(cone_count=6, cone_set="strayphotons6", is_jittered=False)
    normals = even_normals(POINT_COUNT)
    points = 0.7 * even_normals(POINT_COUNT)[::-1]
    found = []
    for values, sign in (((alphas, colors), 1.0), (mirrored, -1.0)):
        volume = pack_volume(opacity_of(layout, values[0]), emittance_of(layout, values[1]))
        mirror = np.array([sign, 1.0, 1.0])
        at = white_receivers(points * mirror, normals * mirror)
        found.append(np.array(trace_diffuse(at, volume, config)))
    np.testing.assert_allclose(found[0], found[1], atol=1e-4)
    assert found[0].mean() > 0.05


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"cone_count": 65}, "no set of 65 cones"),
        ({"cone_set": "none"}, "must be None or one of"),
        ({"cone_set": "compix16"}, "has 16 cones, but cone_count is 17"),
        ({"rotation": "always"}, "must be one of"),
        ({"frame": -1}, ">= 0"),
        ({"normal_offset_voxels": -0.5}, ">= 0"),
        ({"gain": 0.0}, "> 0"),
        ({"aperture_scale": 10.0}, "aperture of .* degrees: lower it"),
    ],
)
def test_sets_that_make_no_sense_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DiffuseConesConfig(**fields)


@pytest.mark.parametrize("name", PEER_CONE_SETS)
def test_a_ray_that_met_nothing_gathers_nothing(name: str) -> None:
    at = white_receivers(np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    at.is_valid = mi.Bool([True, False])
    config = replace(STILL, cone_set=name, cone_count=peer_cone_set(name).cone_count)
    found = np.array(trace_diffuse(at, glowing_fog(), config))
    assert (found[:, 0] > 0.0).all()
    assert (found[:, 1] == 0.0).all()
