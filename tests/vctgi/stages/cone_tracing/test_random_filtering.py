"""Marches over chosen texels: equal to a plain loop, and right in the mean."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from tests.vctgi.twins.marching import march
from tests.vctgi.twins.reading import HostVolume
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import VoxelVolume, pack_volume
from vctgi.clipmap.texel_choice import Filtering, TexelChoice, random_choice
from vctgi.config import preset
from vctgi.stages.cone_tracing.live_march import LiveMarch
from vctgi.stages.cone_tracing.march import ConeMarchConfig, ConeSample, march_cone

pytestmark = pytest.mark.usefixtures("variant")

SINGLE_PRECISION_MARCH = 2e-4
"""As in test_march.py."""

STANDARD_ERRORS = 4.0

THIN = 0.02
"""Opacity of what is marched through where means are compared: how choices bend them, by the
square of what a step stops, is below what is asked."""


def random_volume(thinness: float) -> tuple[VoxelVolume, HostVolume]:
    layout = lay_out_clipmap((0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=3, resolution=8)
    alphas, colors = random_values(layout, seed=2, empty_share=0.7)
    alphas, colors = [thinness * a for a in alphas], [thinness * c for c in colors]
    device = pack_volume(opacity_of(layout, alphas), emittance_of(layout, colors))
    return device, HostVolume(layout, alphas, colors)


def cast(
    volume: VoxelVolume, where: np.ndarray, axis: np.ndarray, config: ConeMarchConfig | LiveMarch
) -> ConeSample:
    ratio, phase = mi.Float(0.4), mi.Float(0.7)
    apex, ways = (mi.Vector3f(np.float32(each.T)) for each in (where, axis))
    return march_cone(volume, mi.Point3f(apex), ways, ratio, phase, config, mi.Bool(True))


def rays(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(count, 3))
    apex = np.array([0.4, -3.0, 2.0]) + rng.uniform(-2.0, 2.0, (count, 3))
    return apex, axis / np.linalg.norm(axis, axis=1, keepdims=True)


@pytest.mark.parametrize("filtering", ["random_level", "random_texel"])
def test_equals_the_twin(filtering: Filtering) -> None:
    device, host = random_volume(0.3)
    count = 24
    apex, axis = rays(count, 4)
    config = ConeMarchConfig(filtering=filtering)
    lane = dr.arange(mi.UInt32, count)
    choice = random_choice(lane, lane, filtering)
    assert choice is not None
    found = cast(device.choosing(choice), apex, axis, config)
    levels = np.array(choice.level, dtype=np.float64)
    offsets = None if choice.offset is None else np.array(choice.offset, dtype=np.float64).T
    for place in range(count):
        chosen = (levels[place], None if offsets is None else offsets[place])
        radiance, transmittance, steps = march(
            host, apex[place], axis[place], 0.4, 0.7, config, chosen
        )
        assert steps == int(found.step_count[place])
        assert float(found.transmittance[place]) == pytest.approx(
            transmittance, abs=SINGLE_PRECISION_MARCH
        )
        np.testing.assert_allclose(
            np.array(found.radiance)[:, place], radiance, atol=2.0 * SINGLE_PRECISION_MARCH
        )


@pytest.mark.parametrize("filtering", ["random_level", "random_texel"])
def test_is_the_interpolated_march_in_the_mean(filtering: Filtering) -> None:
    device, _ = random_volume(THIN)
    kinds, repeats = 16, 2048
    apex, axis = (np.repeat(each, repeats, axis=0) for each in rays(kinds, 5))
    lane = dr.arange(mi.UInt32, kinds * repeats)
    choice = random_choice(lane, lane % 17, filtering)
    found = cast(device.choosing(choice), apex, axis, ConeMarchConfig(filtering=filtering))
    linear = cast(device, apex, axis, ConeMarchConfig())
    for name in ("transmittance", "radiance"):
        values = np.array(getattr(found, name)).reshape(-1, kinds, repeats)
        expected = np.array(getattr(linear, name)).reshape(-1, kinds, repeats)[..., 0]
        error = STANDARD_ERRORS * values.std(axis=-1) / np.sqrt(repeats)
        assert (np.abs(values.mean(axis=-1) - expected) <= error + 4.0 * THIN**2).all()
        assert values.std(axis=-1).max() > 0.0


@pytest.mark.parametrize("name", ["level_bias", "pull_back_voxels", "correction_factor"])
def test_derivatives_are_those_of_the_mean(name: str) -> None:
    device, _ = random_volume(THIN)
    kinds, repeats = 8, 1024
    apex, axis = (np.repeat(each, repeats, axis=0) for each in rays(kinds, 6))
    lane = dr.arange(mi.UInt32, kinds * repeats)

    def slopes(filtering: Filtering) -> np.ndarray:
        live = LiveMarch.of_numbers(ConeMarchConfig(filtering=filtering), None)
        value = getattr(live, name)
        dr.enable_grad(value)
        choice = random_choice(lane, lane % 17, filtering)
        found = cast(device.choosing(choice), apex, axis, live).transmittance
        dr.set_grad(value, 1.0)
        dr.enqueue(dr.ADMode.Forward, value)
        dr.traverse(dr.ADMode.Forward)
        return np.array(dr.grad(found), dtype=np.float64).reshape(kinds, repeats)

    expected = slopes("linear")[:, 0]
    assert np.abs(expected).max() > 1e-4
    for filtering in ("random_level", "random_texel"):
        values = slopes(filtering)
        error = STANDARD_ERRORS * values.std(axis=-1) / np.sqrt(repeats)
        assert (np.abs(values.mean(axis=-1) - expected) <= error + 4.0 * THIN**2).all()


def test_without_the_choice_that_is_wanted_it_is_refused() -> None:
    device, _ = random_volume(THIN)
    apex, axis = rays(2, 7)
    choice = TexelChoice(mi.Float(0.5), None)
    with pytest.raises(ValueError, match=r'filtering is "random_level"'):
        cast(device, apex, axis, ConeMarchConfig(filtering="random_level"))
    with pytest.raises(ValueError, match=r'filtering is "linear"'):
        cast(device.choosing(choice), apex, axis, ConeMarchConfig())
    with pytest.raises(ValueError, match="filtering must be one of"):
        ConeMarchConfig(filtering="nearest")  # type: ignore[arg-type]


def test_cheap_and_fitted_presets_read_one_level() -> None:
    for name in ("medium", "high-fitted"):
        assert preset(name).diffuse.march.filtering == "random_level"
    assert preset("ambient").ambient.march.filtering == "random_level"
    for name in ("high", "ultra"):
        assert preset(name).diffuse.march.filtering == "linear"
