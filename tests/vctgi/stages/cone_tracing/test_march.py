"""The march equals a plain loop, sees as much as it stops, and passes through nothing unchanged."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vctgi.hand_made_volumes import (
    emittance_of,
    homogeneous_volume,
    opacity_of,
    random_values,
)
from tests.vctgi.twins.marching import march
from tests.vctgi.twins.reading import HostVolume
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import VoxelVolume, pack_volume
from vctgi.peers import PEERS
from vctgi.stages.cone_tracing.march import ConeMarchConfig, ConeSample, march_cone

pytestmark = pytest.mark.usefixtures("variant")

SINGLE_PRECISION_MARCH = 2e-4
"""Some hundred steps in single precision, and a stop at a transmittance of 1e-4."""

SINGLE_PRECISION_SUM = 1e-5


def cast(
    volume: VoxelVolume,
    apex: np.ndarray,
    axis: np.ndarray,
    ratio: np.ndarray,
    phase: np.ndarray,
    config: ConeMarchConfig,
) -> ConeSample:
    result = march_cone(
        volume,
        mi.Point3f(np.ascontiguousarray(apex.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(axis.T, dtype=np.float32)),
        mi.Float(ratio.astype(np.float32)),
        mi.Float(phase.astype(np.float32)),
        config,
        dr.full(mi.Bool, True, len(apex)),
    )
    dr.eval(result)
    return result


TRILINEAR = ConeMarchConfig(read="trilinear", weights="normalised", max_distance_voxels=20.0)

CONFIGS = {
    "ours": ConeMarchConfig(),
    "coarser": ConeMarchConfig(level_bias=0.5),
    "trilinear depth": TRILINEAR,
    "spheres": replace(TRILINEAR, correction="exponent", step_rule="spheres"),
    "narrow": replace(TRILINEAR, correction="exponent", max_footprint_voxels=6.0),
    **{name: PEERS[name].diffuse.march for name in ("compix", "wicked_before", "godot_hq")},
}
"""Every rule of the march at least once."""


@pytest.mark.parametrize("level_count", [1, 3])
@pytest.mark.parametrize("name", CONFIGS)
def test_equals_the_twin(level_count: int, name: str) -> None:
    layout = lay_out_clipmap(
        (0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=level_count, resolution=8
    )
    # Thin enough that cones reach far.
    alphas, colors = random_values(layout, seed=2, empty_share=0.7)
    alphas, colors = [0.3 * a for a in alphas], [0.3 * c for c in colors]
    device = pack_volume(opacity_of(layout, alphas), emittance_of(layout, colors))
    host = HostVolume(layout, alphas, colors)
    config = CONFIGS[name]
    rng = np.random.default_rng(4)
    count = 24
    apex = np.array(layout.centre) + rng.uniform(-3.0, 3.0, (count, 3))
    # Some start outside and look in.
    apex[:4] = np.array(layout.centre) + np.array([-40.0, 1.0, 0.5])
    axis = rng.normal(size=(count, 3))
    axis[:4] = [1.0, 0.02, 0.01]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    ratio, phase = rng.uniform(0.05, 1.5, count), rng.uniform(0.01, 1.0, count)
    ratio[:4] = 0.05
    found = cast(device, apex, axis, ratio, phase, config)
    radiance, transmittance = np.array(found.radiance).T, np.array(found.transmittance)
    for lane in range(count):
        slow_radiance, slow_transmittance, _ = march(
            host, apex[lane], axis[lane], ratio[lane], phase[lane], config
        )
        assert transmittance[lane] == pytest.approx(slow_transmittance, abs=SINGLE_PRECISION_MARCH)
        np.testing.assert_allclose(radiance[lane], slow_radiance, atol=2.0 * SINGLE_PRECISION_MARCH)
    # Limited cones see little.
    assert 0.05 < transmittance.mean() < 0.99


@settings(max_examples=25)
@given(
    ratio=st.floats(0.01, 3.0),
    phase=st.floats(0.01, 1.0),
    extinction=st.floats(0.0, 3.0),
    radiance=st.floats(0.0, 10.0),
    axis=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1)),
)
def test_light_seen_and_light_let_through_sum_to_one(
    ratio: float,
    phase: float,
    extinction: float,
    radiance: float,
    axis: tuple[float, float, float],
) -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=2, resolution=8)
    direction = np.array([axis]) / np.linalg.norm(axis)
    volume = homogeneous_volume(layout, extinction, radiance)
    found = cast(
        volume,
        np.array([[0.1, -0.2, 0.05]]),
        direction,
        np.array([ratio]),
        np.array([phase]),
        ConeMarchConfig(),
    )
    seen = float(found.radiance[0][0])
    stopped = 1.0 - float(found.transmittance[0])
    assert seen == pytest.approx(radiance * stopped, abs=SINGLE_PRECISION_SUM * max(radiance, 1.0))


def test_empty_volume_lets_everything_through() -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=2, resolution=8)
    found = cast(
        homogeneous_volume(layout, 0.0),
        np.zeros((1, 3)),
        np.array([[0.0, 0.6, 0.8]]),
        np.array([0.4]),
        np.array([1.0]),
        ConeMarchConfig(),
    )
    assert float(found.transmittance[0]) == 1.0
    assert float(found.radiance[0][0]) == 0.0
    assert int(found.step_count[0]) > 0


def test_inactive_lanes_do_not_march() -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=1, resolution=8)
    found = march_cone(
        homogeneous_volume(layout, 1.0),
        mi.Point3f([0.0, 0.0], [0.0, 0.0], [0.0, 0.0]),
        mi.Vector3f(0.0, 0.0, 1.0),
        mi.Float(0.5),
        mi.Float(1.0),
        ConeMarchConfig(),
        mi.Bool([True, False]),
    )
    assert int(found.step_count[1]) == 0
    assert float(found.transmittance[1]) == 1.0
    assert int(found.step_count[0]) > 0


def test_cone_that_misses_the_window_sees_nothing() -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=1, resolution=8)
    found = cast(
        homogeneous_volume(layout, 1.0),
        np.array([[0.0, 0.0, 50.0]]),
        np.array([[0.0, 0.0, 1.0]]),
        np.array([0.5]),
        np.array([1.0]),
        ConeMarchConfig(),
    )
    assert int(found.step_count[0]) == 0
    assert float(found.transmittance[0]) == 1.0


@pytest.mark.parametrize("name", PEERS)
def test_light_of_every_recipe_is_linear_in_what_glows(name: str) -> None:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.5, level_count=2, resolution=8)
    alphas, colors = random_values(layout, seed=7, empty_share=0.7)
    rng = np.random.default_rng(1)
    axis = rng.normal(size=(16, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    rays = rng.uniform(-1.0, 1.0, (16, 3)), axis, rng.uniform(0.1, 1.0, 16), np.full(16, 1.0)
    found = []
    for factor in (1.0, 2.0, 0.0):
        light = emittance_of(layout, [factor * color for color in colors])
        volume = pack_volume(opacity_of(layout, alphas), light)
        found.append(np.array(cast(volume, *rays, PEERS[name].diffuse.march).radiance))
    assert found[0].mean() > 0.0
    np.testing.assert_array_equal(found[1], 2.0 * found[0])
    assert not found[2].any()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("step_ratio", 0.0, "skips voxels"),
        ("step_ratio", 1.5, "skips voxels"),
        ("min_step_voxels", 0.0, "never end"),
        ("start_offset_voxels", -1.0, ">= 0"),
        ("min_transmittance", 1.0, r"\[0, 1\)"),
        ("sample_place", 1.5, r"\[0, 1\]"),
        ("max_distance_voxels", 0.0, "> 0"),
        ("max_footprint_voxels", -1.0, "> 0"),
        ("weights", "even", "must be one of"),
        ("correction", "exponent", 'use correction="depth" or read="trilinear"'),
        ("color", "proportional", "for the other corrections"),
    ],
)
def test_marches_without_end_are_refused(field: str, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ConeMarchConfig(**{field: value})
