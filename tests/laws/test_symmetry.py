"""A turned or mirrored scene has turned or mirrored voxels, cones and pictures."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.vctgi.hand_made_volumes import (
    emittance_of,
    opacity_of,
    random_values,
)
from tests.vctgi.small_scenes import area_light, camera, color, diffuse, load, room
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import pack_volume
from vctgi.config import preset
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.peers import PEERS
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.scene.triangles import is_degenerate
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone
from vctgi.stages.downsampling import downsample
from vctgi.stages.voxelization.opacity import voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 8

SINGLE_PRECISION_MARCH = 1e-4
"""Mirrored cones round differently: x and -x fall to other sides of the same voxel centres."""

JITTERED_PICTURE = 0.03
"""Relative, of picture means: phases and azimuths of the cones do not turn with the scene."""

QUARTER_TURN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""About y: x to -z, z to x."""

_CORNERS = arrays(
    np.float64,
    st.tuples(st.integers(1, 3), st.just(3), st.just(3)),
    elements=st.floats(-6.0, 6.0, width=32),
)


def layout() -> ClipmapLayout:
    """Windows that are symmetric about the origin."""
    where = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=2, resolution=RESOLUTION
    )
    for level in where.levels:
        assert level.origin == (-level.resolution // 2,) * 3
    return where


def in_window_order(flat: mi.Float, resolution: int) -> np.ndarray:
    """Opacities [direction, z, y, x] with the lowest voxel of the window first."""
    table = np.array(flat).reshape((DIRECTION_COUNT,) + (resolution,) * 3)
    # The lowest voxel, -resolution / 2, is stored in the middle.
    rolled: np.ndarray = np.roll(table, (resolution // 2,) * 3, axis=(1, 2, 3))
    return rolled


def turned_table(table: np.ndarray) -> np.ndarray:
    """Opacities after a quarter turn about y: new x is old z, new z is old -x."""
    voxels = np.swapaxes(table, 1, 3)[:, ::-1]
    # +x becomes -z, -x becomes +z, +z becomes +x, -z becomes -x.
    turned: np.ndarray = voxels[[4, 5, 2, 3, 1, 0]]
    return turned


def mirrored_table(table: np.ndarray) -> np.ndarray:
    """Values [direction, z, y, x, ...] after x to -x."""
    mirrored: np.ndarray = table[[1, 0, 2, 3, 4, 5]][:, :, :, ::-1]
    return mirrored


def voxelized(vertices: np.ndarray) -> list[np.ndarray]:
    opacity, _ = downsample(voxelize_opacity(opaque_surfaces(vertices), layout()), None)
    return [
        in_window_order(flat, level.resolution)
        for flat, level in zip(opacity.levels, layout().levels, strict=True)
    ]


@settings(max_examples=25)
@given(corners=_CORNERS)
def test_quarter_turn_permutes_the_directions(corners: np.ndarray) -> None:
    assume(not is_degenerate(corners).any())
    straight, turned = voxelized(corners), voxelized(corners @ QUARTER_TURN.T)
    for before, after in zip(straight, turned, strict=True):
        np.testing.assert_array_equal(after, turned_table(before))


@settings(max_examples=25)
@given(corners=_CORNERS)
def test_mirroring_swaps_two_directions(corners: np.ndarray) -> None:
    assume(not is_degenerate(corners).any())
    # A mirroring turns the winding over.
    mirrored = (corners * np.array([-1.0, 1.0, 1.0]))[:, ::-1]
    for before, after in zip(voxelized(corners), voxelized(mirrored), strict=True):
        np.testing.assert_array_equal(after, mirrored_table(before))


MARCHES = {"ours": ConeMarchConfig()} | {
    name: PEERS[name].diffuse.march for name in ("classic", "compix", "wicked_before", "ogre")
}


@pytest.mark.parametrize("name", MARCHES)
def test_mirrored_cones_see_the_same_in_a_mirrored_volume(name: str) -> None:
    where = layout()
    alphas, colors = random_values(where, seed=9, empty_share=0.8)
    symmetric_alphas, symmetric_colors = [], []
    for alpha, emitted in zip(alphas, colors, strict=True):
        # In storage order voxel x mirrors to voxel -1 - x, and so does its texel.
        symmetric_alphas.append(0.5 * (alpha + mirrored_table(alpha)))
        symmetric_colors.append(0.5 * (emitted + mirrored_table(emitted)))
    volume = pack_volume(opacity_of(where, symmetric_alphas), emittance_of(where, symmetric_colors))
    rng = np.random.default_rng(2)
    count = 500
    apex = rng.uniform(-3.0, 3.0, (count, 3))
    axis = rng.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    ratio, phase = rng.uniform(0.1, 1.5, count), rng.uniform(0.1, 1.0, count)
    found = []
    for sign in (1.0, -1.0):
        mirror = np.array([sign, 1.0, 1.0])
        cone = march_cone(
            volume,
            mi.Point3f(np.ascontiguousarray((apex * mirror).T, dtype=np.float32)),
            mi.Vector3f(np.ascontiguousarray((axis * mirror).T, dtype=np.float32)),
            mi.Float(ratio.astype(np.float32)),
            mi.Float(phase.astype(np.float32)),
            MARCHES[name],
            dr.full(mi.Bool, True, count),
        )
        found.append((np.array(cone.radiance), np.array(cone.transmittance)))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=SINGLE_PRECISION_MARCH)
    np.testing.assert_allclose(found[0][1], found[1][1], atol=SINGLE_PRECISION_MARCH)
    assert found[0][0].mean() > 0.1


def render(outer: np.ndarray, is_tinted: bool = False) -> np.ndarray:
    """Picture of a room with a lamp in the middle of its ceiling, all of it moved by a matrix."""
    matrix = np.eye(4)
    matrix[:3, :3] = outer
    to_world = mi.ScalarTransform4f(matrix.tolist())
    walls = room(to_world, bsdf=diffuse(0.6))
    if is_tinted:
        walls["wall1"]["bsdf"] = {"type": "diffuse", "reflectance": color(0.7, 0.1, 0.1)}
    place = to_world @ mi.ScalarTransform4f().translate([0, 0.95, 0]).rotate([1, 0, 0], 90)
    lamp = {"type": "rectangle", "to_world": place.scale(0.3), "emitter": area_light(5.0)}
    eye = camera([0.0, 0.0, 0.95], [0.0, -0.1, 0.0], size=32, fov=80.0, outer=to_world)
    scene = load(sensor=eye, lamp=lamp, **walls)
    config = preset("high")
    config = replace(
        config,
        diffuse=replace(config.diffuse, rotation="fixed"),
        # The pattern of sparse pixels has no mirror image in itself.
        reconstruction=replace(config.reconstruction, sparsity=1),
        # One finest level about the origin, whatever the picture shows.
        clipmap=replace(
            config.clipmap,
            resolution=32,
            finest_voxel_size=2.0 / 26.5,
            centre=(0.0, 0.0, 0.0),
            level_count=1,
        ),
    )
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    picture: np.ndarray = np.array(frame.indirect_diffuse)
    return picture


def test_quarter_turn_of_scene_and_camera_keeps_the_picture() -> None:
    straight, turned = render(np.eye(3), is_tinted=True), render(QUARTER_TURN, is_tinted=True)
    for row, column in ((slice(None), slice(16)), (slice(None), slice(16, None))):
        first, second = straight[row, column].mean(), turned[row, column].mean()
        assert second == pytest.approx(first, rel=JITTERED_PICTURE)


def test_symmetric_scene_gives_a_symmetric_picture() -> None:
    picture = render(np.eye(3))
    left, right = picture[:, :16].mean(), picture[:, :15:-1].mean()
    assert left == pytest.approx(right, rel=JITTERED_PICTURE)
