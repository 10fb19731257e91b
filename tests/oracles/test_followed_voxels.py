"""Oracle 9: voxels that follow camera, objects and light equal ones made anew, bit for bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.regions import Bounds, own_regions, stale_regions, unmerged_regions
from vctgi.clipmap.slots import SlotRule
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.scene.surfaces import VoxelSurfaces, opaque_surfaces
from vctgi.stages.downsampling import downsample, downsample_regions
from vctgi.stages.light_injection import (
    LightInjectionConfig,
    inject_light,
    relit_regions,
    update_emittance,
)
from vctgi.stages.voxelization.opacity import (
    DEFAULT_CONFIG,
    OpacityVoxelizationConfig,
    voxelize_opacity,
)
from vctgi.stages.voxelization.triangles import unit_normals, upload_triangles
from vctgi.stages.voxelization.update import changed_bounds, update_opacity

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 8
VOXEL_SIZE = 0.3
OBJECT_COUNT = 4
BY_SCATTER = LightInjectionConfig()


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
        return opaque_surfaces(np.zeros((0, 3, 3)))
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return replace(opaque_surfaces(np.concatenate(parts)), shape_index=owner)


def assert_same(
    found: Sequence[mi.Float | mi.Color3f], other: Sequence[mi.Float | mi.Color3f]
) -> None:
    for own, expected in zip(found, other, strict=True):
        np.testing.assert_array_equal(np.array(own), np.array(expected))


def lit_points(parts: list[np.ndarray], flux: list[float]) -> list[ReflectiveShadowMap]:
    """Light on the corners and middles of every triangle of every object."""
    maps = []
    for part, each in zip(parts, flux, strict=True):
        points = np.concatenate([part[:, 0], part[:, 1], part[:, 2], part.mean(axis=1)])
        normal = np.tile(unit_normals(part), (4, 1))
        power = dr.full(mi.Float, each, len(points))
        maps.append(
            ReflectiveShadowMap(
                light_name="",
                level=None,
                position=mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32)),
                normal=mi.Vector3f(np.ascontiguousarray(normal.T, dtype=np.float32)),
                incident_flux=mi.Color3f(power),
                reflected_flux=mi.Color3f(power),
                radiance=mi.Color3f(0.3 * power),
            )
        )
    return maps


STEP = st.tuples(*[st.floats(-1.5, 1.5)] * 3)
KIND = st.sampled_from(["camera", "far camera", "move", "remove", "add", "light", "nothing"])
Steps = list[tuple[str, int, tuple[float, float, float]]]
WALK = st.lists(st.tuples(KIND, st.integers(0, OBJECT_COUNT - 1), STEP), min_size=1, max_size=3)


@dataclass
class World:
    """Objects with the light on each, and where the camera stands."""

    parts: list[np.ndarray]
    flux: list[float]
    centre: np.ndarray

    def change(self, kind: str, which: int, step: np.ndarray, seed: int) -> list[Bounds]:
        """Take one step; return boxes around what is lit otherwise without having moved."""
        if kind == "camera":
            self.centre = self.centre + step
        elif kind == "far camera":
            self.centre = self.centre + 20.0 * step
        elif kind == "add":
            self.parts.append(objects(seed + 1)[which] + step)
            self.flux.append(0.7)
        elif self.parts:
            which = which % len(self.parts)
            if kind == "move":
                self.parts[which] = self.parts[which] + step
            elif kind == "remove":
                del self.parts[which], self.flux[which]
            elif kind == "light":
                self.flux[which] = 0.5 + abs(step[0])
                return [(self.parts[which].min(axis=(0, 1)), self.parts[which].max(axis=(0, 1)))]
        return []


def walk(
    seed: int,
    steps: Steps,
    config: OpacityVoxelizationConfig,
    injection: LightInjectionConfig = BY_SCATTER,
) -> None:
    world = World(objects(seed), [0.3, 0.5, 0.9, 1.1], np.zeros(3))
    surfaces, layout = scene_of(world.parts), layout_at(world.centre)
    direct = voxelize_opacity(surfaces, layout, config)
    emittance = inject_light(lit_points(world.parts, world.flux), direct, injection)
    merged, lit = downsample(direct, emittance)
    assert lit is not None
    for kind, which, step in steps:
        before = surfaces, layout
        relit = world.change(kind, which, np.array(step), seed)
        surfaces, layout = scene_of(world.parts), layout_at(world.centre)
        changed = changed_bounds(before[0], surfaces)
        direct, _ = update_opacity(direct, upload_triangles(surfaces), layout, changed, config)
        dark = stale_regions(before[1], layout, changed + relit, config.reach_voxels)
        had = list(emittance.steps_per_unit)
        maps = lit_points(world.parts, world.flux)
        emittance = update_emittance(emittance, maps, direct, dark, injection)
        dark = relit_regions(layout, dark, injection)
        dark += [[] for _ in layout.levels[layout.clip_level_count :]]
        if emittance.steps_per_unit != had:
            dark = [own_regions(layout, level) for level in layout.clip_levels]
            dark += [[] for _ in layout.levels[layout.clip_level_count :]]
        merged = OpacityClipmap(layout, merged.levels, merged.rule)
        lit = EmittanceClipmap(layout, lit.levels, emittance.lost_flux_share)
        downsample_regions(
            direct, emittance, merged, lit, unmerged_regions(before[1], layout, dark)
        )

    expected = voxelize_opacity(surfaces, layout, config)
    assert_same(direct.levels, expected.levels)
    light = inject_light(lit_points(world.parts, world.flux), expected, injection)
    assert_same(emittance.levels, light.levels)
    assert emittance.lost_flux_share == light.lost_flux_share
    expected_merged, expected_lit = downsample(expected, light)
    assert expected_lit is not None
    assert_same(merged.levels, expected_merged.levels)
    assert_same(lit.levels, expected_lit.levels)


@settings(max_examples=200)
@given(seed=st.integers(0, 1000), steps=WALK)
def test_walks_of_camera_and_objects_equal_a_rebuild(seed: int, steps: Steps) -> None:
    walk(seed, steps, DEFAULT_CONFIG)


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), steps=WALK)
@pytest.mark.parametrize(
    "config",
    [
        OpacityVoxelizationConfig(slots=SlotRule(thickness_voxels=1.7)),
        OpacityVoxelizationConfig(max_supersampling=4),
        OpacityVoxelizationConfig(is_two_sided=True),
        OpacityVoxelizationConfig(coverage="analytic"),
        OpacityVoxelizationConfig(coverage="samples"),
    ],
    ids=["thick", "supersampled", "two-sided", "analytic", "samples"],
)
def test_walks_equal_a_rebuild_with_every_option(
    config: OpacityVoxelizationConfig,
    seed: int,
    steps: Steps,
) -> None:
    walk(seed, steps, config)


@settings(max_examples=15)
@given(seed=st.integers(0, 1000), steps=WALK)
@pytest.mark.parametrize(
    "injection",
    [
        LightInjectionConfig(algorithm="gather"),
        LightInjectionConfig(algorithm="centre"),
        LightInjectionConfig(normalisation="radiance"),
        LightInjectionConfig(prefilter=3),
        LightInjectionConfig(prefilter=5, algorithm="gather", normalisation="radiance"),
    ],
    ids=["gather", "centre", "bounded", "3 wide", "5 wide"],
)
def test_walks_equal_a_rebuild_with_every_injection(
    injection: LightInjectionConfig, seed: int, steps: Steps
) -> None:
    walk(seed, steps, DEFAULT_CONFIG, injection)


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


def test_changed_bounds_follow_surfaces_and_not_their_order() -> None:
    parts = objects(5)
    before = scene_of(parts)
    order = np.array([0, 2, 1, *range(3, 3 * OBJECT_COUNT)])
    swapped = replace(
        before, vertices=before.vertices[order], shape_index=before.shape_index[order]
    )
    assert changed_bounds(before, swapped) == []
    shifted = before.uv.copy()
    shifted[-1] += 0.25
    for bounds in changed_bounds(swapped, replace(before, uv=shifted)):
        np.testing.assert_array_equal(bounds[0], parts[-1][-1].min(axis=0))
        np.testing.assert_array_equal(bounds[1], parts[-1][-1].max(axis=0))
    nothing = scene_of([])
    assert changed_bounds(nothing, scene_of([])) == []


def test_unchanged_surfaces_are_not_even_read() -> None:
    # So that a moving camera costs the same, however many triangles the scene has.
    unread = cast("VoxelSurfaces", object())
    assert changed_bounds(unread, unread) == []
