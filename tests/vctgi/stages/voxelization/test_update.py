"""Oracle 9: a clipmap that follows camera and objects equals one that is built anew, bit by bit."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vctgi.hand_made_volumes import surfaces_of
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.regions import unmerged_regions
from vctgi.clipmap.slots import SlotRule
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.downsampling import downsample, downsample_regions
from vctgi.stages.voxelization.opacity import (
    DEFAULT_CONFIG,
    OpacityVoxelizationConfig,
    voxelize_opacity,
)
from vctgi.stages.voxelization.triangles import upload_triangles
from vctgi.stages.voxelization.update import changed_bounds, update_opacity

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 8
VOXEL_SIZE = 0.3
OBJECT_COUNT = 4


def layout_at(centre: np.ndarray) -> ClipmapLayout:
    x, y, z = centre.tolist()
    return lay_out_clipmap(
        (x, y, z), finest_voxel_size=VOXEL_SIZE, level_count=3, resolution=RESOLUTION
    )


def objects(seed: int) -> list[np.ndarray]:
    """Objects of a few triangles each, all around the origin."""
    rng = np.random.default_rng(seed)
    return [
        rng.uniform(-2.5, 2.5, (1, 1, 3)) + rng.uniform(-1.0, 1.0, (3, 3, 3))
        for _ in range(OBJECT_COUNT)
    ]


def scene_of(parts: list[np.ndarray]) -> VoxelSurfaces:
    if not parts:
        return surfaces_of(np.zeros((0, 3, 3)))
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return replace(surfaces_of(np.concatenate(parts)), shape_index=owner)


def assert_same(found: OpacityClipmap, expected: OpacityClipmap) -> None:
    assert found.layout == expected.layout
    for own, other in zip(found.levels, expected.levels, strict=True):
        np.testing.assert_array_equal(np.array(own), np.array(other))


STEP = st.tuples(*[st.floats(-1.5, 1.5)] * 3)
KIND = st.sampled_from(["camera", "far camera", "move", "remove", "add", "nothing"])
WALK = st.lists(st.tuples(KIND, st.integers(0, OBJECT_COUNT - 1), STEP), min_size=1, max_size=3)


def walk(
    seed: int, steps: list[tuple[str, int, tuple[float, ...]]], config: OpacityVoxelizationConfig
) -> None:
    parts, centre = objects(seed), np.zeros(3)
    surfaces, layout = scene_of(parts), layout_at(centre)
    direct = voxelize_opacity(surfaces, layout, config)
    merged, _ = downsample(direct, None)
    for kind, which, step in steps:
        before = surfaces, layout
        if kind == "camera":
            centre = centre + np.array(step)
        elif kind == "far camera":
            centre = centre + 20.0 * np.array(step)
        elif kind == "move" and parts:
            moved = parts[which % len(parts)] + np.array(step)
            parts = [*parts[: which % len(parts)], moved, *parts[which % len(parts) + 1 :]]
        elif kind == "remove" and parts:
            parts = [part for number, part in enumerate(parts) if number != which % len(parts)]
        elif kind == "add":
            parts = [*parts, objects(seed + 1)[which] + np.array(step)]
        surfaces, layout = scene_of(parts), layout_at(centre)
        direct, stale = update_opacity(
            direct, upload_triangles(surfaces), layout, changed_bounds(before[0], surfaces), config
        )
        merged = OpacityClipmap(layout, merged.levels, merged.rule)
        unmerged = unmerged_regions(before[1], layout, stale)
        downsample_regions(direct, None, merged, None, unmerged)

    expected = voxelize_opacity(surfaces, layout, config)
    assert_same(direct, expected)
    assert_same(merged, downsample(expected, None)[0])


@settings(max_examples=200)
@given(seed=st.integers(0, 1000), steps=WALK)
def test_walks_of_camera_and_objects_equal_a_rebuild(
    seed: int, steps: list[tuple[str, int, tuple[float, ...]]]
) -> None:
    walk(seed, steps, DEFAULT_CONFIG)


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), steps=WALK)
@pytest.mark.parametrize(
    "config",
    [
        OpacityVoxelizationConfig(slots=SlotRule(thickness_voxels=1.7)),
        OpacityVoxelizationConfig(max_supersampling=4),
        OpacityVoxelizationConfig(is_two_sided=True),
    ],
    ids=["thick", "supersampled", "two-sided"],
)
def test_walks_equal_a_rebuild_with_every_option(
    config: OpacityVoxelizationConfig,
    seed: int,
    steps: list[tuple[str, int, tuple[float, ...]]],
) -> None:
    walk(seed, steps, config)


def test_moving_camera_compiles_nothing_new() -> None:
    surfaces = scene_of(objects(3))
    triangles = upload_triangles(surfaces)

    def follow() -> list[str]:
        direct = voxelize_opacity(surfaces, layout_at(np.zeros(3)))
        missed = []
        for step in range(12):
            centre = np.array([0.3 * step, 0.0, 0.0])
            with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
                dr.kernel_history_clear()
                direct, _ = update_opacity(direct, triangles, layout_at(centre))
                kernels = dr.kernel_history((dr.KernelType.JIT,))
            missed += [kernel["hash"] for kernel in kernels if not kernel["cache_hit"]]
        return missed

    follow()
    assert follow() == []


def test_update_touches_only_what_entered() -> None:
    surfaces = scene_of(objects(3))
    direct = voxelize_opacity(surfaces, layout_at(np.zeros(3)))
    _, stale = update_opacity(
        direct, upload_triangles(surfaces), layout_at(np.array([2 * VOXEL_SIZE, 0.0, 0.0]))
    )
    assert [sum(box.voxel_count for box in boxes) for boxes in stale[:1]] == [2 * RESOLUTION**2]


def test_other_levels_or_another_thickness_are_refused() -> None:
    surfaces = scene_of(objects(3))
    direct = voxelize_opacity(surfaces, layout_at(np.zeros(3)))
    other = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.2, level_count=3, resolution=8)
    with pytest.raises(ValueError, match="voxelize anew"):
        update_opacity(direct, upload_triangles(surfaces), other)
    thick = OpacityVoxelizationConfig(slots=SlotRule(thickness_voxels=0.5))
    with pytest.raises(ValueError, match="another thickness"):
        update_opacity(direct, upload_triangles(surfaces), layout_at(np.zeros(3)), config=thick)


def test_changed_bounds_are_those_of_the_objects_that_changed() -> None:
    parts = objects(5)
    before = scene_of(parts)
    assert changed_bounds(before, before) == []
    moved = [parts[0] + np.array([1.0, 0.0, 0.0]), *parts[1:]]
    (low, high), (new_low, new_high) = changed_bounds(before, scene_of(moved))
    np.testing.assert_array_equal(low, parts[0].min(axis=(0, 1)))
    np.testing.assert_array_equal(new_high, moved[0].max(axis=(0, 1)))
    np.testing.assert_allclose(new_low - low, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(new_high - high, [1.0, 0.0, 0.0])
    # One of two equal surfaces that goes is a change.
    twice = scene_of([parts[0], parts[0]])
    assert len(changed_bounds(twice, scene_of([parts[0]]))) == 1
