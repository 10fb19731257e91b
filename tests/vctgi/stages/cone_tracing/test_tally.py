"""Counts of what cones read: equal to what NumPy counts, over all cones that march and no other."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from tests.vctgi.surface_points import points_in_room
from tests.vctgi.twins.marching import march
from tests.vctgi.twins.reading import HostVolume
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import VoxelVolume, pack_volume
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, trace_diffuse
from vctgi.stages.cone_tracing.march import ConeMarchConfig, ConeSample, march_cone
from vctgi.stages.cone_tracing.tally import SampleTally

pytestmark = pytest.mark.usefixtures("variant")

ROUNDED_SHARE = 0.05
"""Cones that may take one step more or less than in double precision: those whose last step or
whose transmittance ends within rounding of its limit."""


def empty_volume(layout: ClipmapLayout) -> VoxelVolume:
    shapes = [(6,) + (level.resolution,) * 3 for level in layout.levels]
    dark = [np.zeros((*shape, 3)) for shape in shapes]
    return pack_volume(
        opacity_of(layout, [np.zeros(shape) for shape in shapes]), emittance_of(layout, dark)
    )


def test_thin_cones_through_nothing_take_a_step_each_quarter_voxel() -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=1, resolution=8)
    # An eighth of a voxel off the grid of the steps, so that rounding cannot add one.
    x = np.arange(-7, 7, dtype=np.float32) * 0.125 + 0.0625
    config = ConeMarchConfig(start_offset_voxels=0.0, min_step_voxels=0.25)
    active = np.arange(len(x)) % 3 != 0
    sample = march_cone(
        empty_volume(layout),
        mi.Point3f(mi.Float(x), 0.0, 0.0),
        mi.Vector3f(1.0, 0.0, 0.0),
        mi.Float(0.0),
        mi.Float(1.0),
        config,
        mi.Bool(active),
    )
    tally = SampleTally()
    tally.add(sample, mi.Bool(active))
    steps = np.ceil((layout.coarsest.window_max[0] - x) / 0.125)
    np.testing.assert_array_equal(np.array(sample.step_count), np.where(active, steps, 0))
    assert tally == SampleTally(cone_count=int(active.sum()), sample_count=int(steps[active].sum()))


@pytest.mark.parametrize("level_count", [1, 3])
def test_counts_what_the_twin_counts(level_count: int) -> None:
    layout = lay_out_clipmap(
        (0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=level_count, resolution=8
    )
    alphas, colors = random_values(layout, seed=level_count, empty_share=0.8)
    volume = pack_volume(opacity_of(layout, alphas), emittance_of(layout, colors))
    rng = np.random.default_rng(5)
    count = 60
    apex = rng.uniform(-1.5, 1.5, (count, 3)) + np.array(layout.centre)
    axis = rng.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    ratio, phase = rng.uniform(0.05, 1.0, count), rng.uniform(0.2, 1.0, count)
    config = ConeMarchConfig(min_transmittance=0.01)
    sample = march_cone(
        volume,
        mi.Point3f(np.ascontiguousarray(apex.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(axis.T, dtype=np.float32)),
        mi.Float(ratio.astype(np.float32)),
        mi.Float(phase.astype(np.float32)),
        config,
        dr.full(mi.Bool, True, count),
    )
    tally = SampleTally()
    tally.add(sample, mi.Bool(True))
    host = HostVolume(layout, alphas, colors)
    expected = np.array(
        [march(host, *cone, config)[2] for cone in zip(apex, axis, ratio, phase, strict=True)]
    )
    off = np.abs(np.array(sample.step_count).astype(int) - expected)
    assert off.max() <= 1
    assert off.mean() <= ROUNDED_SHARE
    assert tally.sample_count == int(np.array(sample.step_count).sum())
    assert tally.cone_count == count


@pytest.mark.parametrize("cone_set", [None, "crassin6", "compix16"])
def test_diffuse_cones_of_points_that_reflect_are_counted_and_no_other(
    cone_set: str | None,
) -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=1, resolution=16)
    alphas, colors = random_values(layout, seed=3, empty_share=0.8)
    volume = pack_volume(opacity_of(layout, alphas), emittance_of(layout, colors))
    config = DiffuseConesConfig(
        cone_count={None: 5, "crassin6": 6, "compix16": 16}[cone_set], cone_set=cone_set
    )
    points, normals = points_in_room(40, seed=2)
    at = white_receivers(points, normals)
    at.is_valid = dr.arange(mi.UInt32, 40) % 4 != 0
    tally = SampleTally()
    counted = trace_diffuse(at, volume, config, tally=tally)
    above = (normals @ np.array(config.cones().directions).T > 0.0).sum(axis=1)
    per_point = above if config.cones().frame == "world" else np.full(40, config.cone_count)
    assert tally.cone_count == int(per_point[np.arange(40) % 4 != 0].sum())
    assert tally.sample_count >= tally.cone_count
    assert tally.ray_count == 0
    # Light is the same, counted or not; so are the counts of the same work in two halves.
    np.testing.assert_array_equal(np.array(counted), np.array(trace_diffuse(at, volume, config)))
    halves = SampleTally()
    for begin in (0, 20):
        part = dr.gather(type(at), at, dr.arange(mi.UInt32, 20) + begin)
        trace_diffuse(part, volume, config, tally=halves)
    assert halves == tally


def test_real_rays_are_counted_apart_and_end_cones() -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.25, level_count=1, resolution=16)
    shapes = [(6,) + (level.resolution,) * 3 for level in layout.levels]
    volume = pack_volume(
        opacity_of(layout, [np.ones(shape) for shape in shapes]),
        emittance_of(layout, [np.ones((*shape, 3)) for shape in shapes]),
    )
    wall = mi.ScalarTransform4f().translate([0, 0, 0.2]).scale(1.0)
    scene = mi.load_dict({"type": "scene", "wall": {"type": "rectangle", "to_world": wall}})
    # The first point looks at the wall, the second away from it.
    at = white_receivers(np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    config = replace(DiffuseConesConfig(cone_count=1), near_field_voxels=2.0)
    tally = SampleTally()
    trace_diffuse(at, volume, config, scene, tally=tally)
    assert tally.ray_count == 2
    assert tally.cone_count == 1


def test_a_sum_beyond_32_bits_is_right() -> None:
    count = 1 << 12
    tally = SampleTally()
    zeros = dr.zeros(mi.Color3f, count)
    sample = ConeSample(zeros, dr.zeros(mi.Float, count), dr.full(mi.UInt32, 0xFFFFFFFF, count))
    tally.add(sample, dr.full(mi.Bool, True, count))
    assert tally.sample_count == count * 0xFFFFFFFF
