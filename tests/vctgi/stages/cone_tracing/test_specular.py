"""Specular cones: noise bound to pixels, and what a lobe's cones see of an even world."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import load
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume, pack_volume
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.scene.sky import PrefilteredSky, SkyConfig, prefilter_sky
from vctgi.stages.cone_tracing.specular import (
    BLUE_NOISE,
    PATTERN_EDGE,
    SpecularConesConfig,
    blue_noise_phase,
    specular_march,
    trace_specular,
)

pytestmark = pytest.mark.usefixtures("variant")

ROUNDING = 1e-5


def empty_volume() -> VoxelVolume:
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.25, level_count=1, resolution=8)
    counts = [DIRECTION_COUNT * each.voxel_count for each in layout.levels]
    opacity = OpacityClipmap(layout, [dr.zeros(mi.Float, count) for count in counts])
    dark = EmittanceClipmap(layout, [dr.zeros(mi.Color3f, count) for count in counts], [0.0])
    return pack_volume(opacity, dark)


def even_sky() -> PrefilteredSky:
    world = load(ball={"type": "sphere"}, sky={"type": "constant", "radiance": 1.0})
    return prefilter_sky(world.environment(), SkyConfig(resolution=32))


def points(apertures: np.ndarray) -> GBuffer:
    """Points at the origin on a floor, seen from the side, with lobes of these apertures."""
    count = len(apertures)
    gbuffer = dr.zeros(GBuffer, count)
    gbuffer.sample_index = dr.arange(mi.UInt32, count)
    gbuffer.is_valid = dr.full(mi.Bool, True, count)
    gbuffer.normal = dr.zeros(mi.Vector3f, count) + mi.Vector3f(0.0, 0.0, 1.0)
    gbuffer.specular_axis = dr.zeros(mi.Vector3f, count) + mi.Vector3f(0.6, 0.0, 0.8)
    gbuffer.ray_direction = dr.zeros(mi.Vector3f, count) + mi.Vector3f(0.6, 0.0, -0.8)
    gbuffer.specular_albedo = dr.full(mi.Color3f, 0.5, count)
    gbuffer.passed = dr.full(mi.Color3f, 0.25, count)
    gbuffer.specular_aperture = mi.Float(apertures)
    return gbuffer


@pytest.mark.parametrize("cone_count", [1, 4, 7, 13])
def test_even_world_is_seen_evenly_by_every_lobe(cone_count: int) -> None:
    gbuffer = points(np.linspace(0.0, 3.0, 32))
    config = SpecularConesConfig(rough_cone_count=cone_count)
    light = trace_specular(
        gbuffer, empty_volume(), config, has_specular=True, has_passing=True, sky=even_sky()
    )
    np.testing.assert_allclose(np.array(light.reflected), 1.0, rtol=ROUNDING)
    np.testing.assert_allclose(np.array(light.passed), 1.0, rtol=ROUNDING)
    np.testing.assert_allclose(np.array(light.towards_viewer(gbuffer)), 0.75, rtol=ROUNDING)


def test_points_without_lobes_see_nothing() -> None:
    gbuffer = points(np.full(4, 1.0))
    gbuffer.specular_albedo = dr.zeros(mi.Color3f, 4)
    gbuffer.passed = dr.zeros(mi.Color3f, 4)
    light = trace_specular(
        gbuffer,
        empty_volume(),
        SpecularConesConfig(),
        has_specular=True,
        has_passing=True,
        sky=even_sky(),
    )
    assert not np.array(light.reflected).any()
    assert not np.array(light.passed).any()


def test_sixteen_phases_in_any_four_by_four_pixels() -> None:
    assert sorted(BLUE_NOISE) == list(range(16))
    width, height = 11, 9
    phase = np.array(blue_noise_phase(FilmSample(width), width * height)).reshape(height, width)
    for top in range(height - PATTERN_EDGE + 1):
        for left in range(width - PATTERN_EDGE + 1):
            window = phase[top : top + PATTERN_EDGE, left : left + PATTERN_EDGE]
            np.testing.assert_allclose(
                np.sort(window.ravel()), (np.arange(16) + 0.5) / 16.0, atol=ROUNDING
            )


def test_pattern_is_blue() -> None:
    # White noise has the same power at every frequency; the lowest ones must have little.
    turns = np.exp(2j * math.pi * np.array(BLUE_NOISE).reshape(4, 4) / 16.0)
    power = np.abs(np.fft.fft2(turns)) ** 2
    lowest = power[0, 1] + power[0, 3] + power[1, 0] + power[3, 0]
    assert lowest / power.sum() < 0.25 * 4.0 / 15.0


def test_samples_of_a_pixel_have_other_phases() -> None:
    first, second = (np.array(blue_noise_phase(FilmSample(4, k), 16)) % 1.0 for k in (0, 1))
    apart = np.abs(first - second)
    assert np.minimum(apart, 1.0 - apart).min() > 0.2


def test_blue_noise_needs_pixels() -> None:
    config = SpecularConesConfig(noise="blue")
    with pytest.raises(ValueError, match="bound to pixels"):
        trace_specular(
            points(np.ones(4)), empty_volume(), config, has_specular=True, has_passing=False
        )


def test_step_of_one_voxel_is_one_voxel_of_what_is_read() -> None:
    march = specular_march(1.0)
    assert march.min_step_voxels == 1.0
    # A footprint of f is read at voxels of f * 2^level_bias.
    assert march.step_ratio == 2.0**march.level_bias


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"noise": "pink"}, "noise must be one of"),
        ({"phase_offset": 1.0}, "phase_offset must be in"),
        ({"rough_cone_count": 3}, "rough_cone_count must be 1 or 4..13"),
        ({"rough_aperture": 0.0}, "rough_aperture must be > 0"),
        ({"min_aperture": 0.0}, "min_aperture must be > 0"),
    ],
)
def test_cones_that_do_not_exist_are_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        SpecularConesConfig(**change)  # type: ignore[arg-type]  # wrong on purpose
