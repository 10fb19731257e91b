"""Voxels that are stored while they are downsampled equal those that are stored afterwards."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import (
    EmittanceClipmap,
    OpacityClipmap,
    StorageConfig,
    VoxelVolume,
    pack_volume,
)
from vctgi.clipmap.stored_directions import SIX, StoredDirections, facing_directions
from vctgi.clipmap.texture import TextureTexels
from vctgi.clipmap.unpacking import unpack_level
from vctgi.stages.downsampling import DownsamplingConfig, downsample, downsample_volume, packed

pytestmark = pytest.mark.usefixtures("variant")

HALF_STEP = 2.0**-11
"""Relative: half a step of half precision."""

FOUR = facing_directions((True, False, True, True, False, True))


def layout(level_count: int = 3) -> ClipmapLayout:
    return lay_out_clipmap(
        (0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=level_count, resolution=8
    )


def voxels(
    where: ClipmapLayout, empty: tuple[int, ...] = ()
) -> tuple[OpacityClipmap, EmittanceClipmap]:
    alphas, colors = random_values(where, 5)
    for level in empty:
        alphas[level][...], colors[level][...] = 0.0, 0.0
    for level in range(where.clip_level_count, len(where.levels)):
        alphas[level][...], colors[level][...] = 0.0, 0.0
    return opacity_of(where, alphas), emittance_of(where, colors)


def words(volume: VoxelVolume) -> np.ndarray:
    assert isinstance(volume.texels, GatheredTexels)
    return np.array(volume.texels.words)


def packed_in_texture(
    opacity: OpacityClipmap, emittance: EmittanceClipmap, directions: StoredDirections
) -> VoxelVolume:
    """As `downsample_volume`; without a GPU the texture is computed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packed, "storage_in_use", lambda storage, *_, **__: storage)
        storage = StorageConfig(format="texture16")
        return downsample_volume(opacity, emittance, DownsamplingConfig(), storage, directions)


@pytest.mark.parametrize("mips", ["columns", "average"])
@pytest.mark.parametrize("directions", [None, SIX, FOUR])
@pytest.mark.parametrize("empty", [(), (0,), (0, 1), (1,), (0, 1, 2)])
def test_equals_downsampling_before_storage(
    mips: str, directions: StoredDirections | None, empty: tuple[int, ...]
) -> None:
    opacity, emittance = voxels(layout(), empty)
    config, storage = DownsamplingConfig(mips=mips), StorageConfig()  # type: ignore[arg-type]
    merged, lit = downsample(opacity, emittance, config)
    assert lit is not None
    expected = pack_volume(merged, lit, storage, directions)
    found = downsample_volume(opacity, emittance, config, storage, directions)
    np.testing.assert_array_equal(words(found), words(expected))
    for name in ("windows", "voxel_offsets", "centre", "low", "high"):
        ours, theirs = getattr(found.table, name), getattr(expected.table, name)
        np.testing.assert_array_equal(np.array(ours), np.array(theirs))


@pytest.mark.parametrize("directions", [SIX, FOUR])
@pytest.mark.parametrize("empty", [(), (0,), (0, 1)])
@pytest.mark.parametrize("factor", [1.0, 1e8, 1e-8])
def test_a_texture_holds_the_same_in_half_precision(
    directions: StoredDirections, empty: tuple[int, ...], factor: float
) -> None:
    opacity, emittance = voxels(layout(), empty)
    emittance.levels = [color * factor for color in emittance.levels]
    merged, lit = downsample(opacity, emittance, DownsamplingConfig())
    assert lit is not None
    expected = pack_volume(merged, lit, StorageConfig(), directions)
    found = packed_in_texture(opacity, emittance, directions)
    assert isinstance(found.texels, TextureTexels)
    # Two neighbours shine through where the unit's weights are off.
    leak = 2.0 * found.texels.weight_error()
    for level in found.layout.levels:
        ours, theirs = (unpack_level(each, level) for each in (found, expected))
        for name in ("emittance", "opacity"):
            a, b = (np.array(getattr(each, name)) for each in (ours, theirs))
            np.testing.assert_allclose(a, b, rtol=1.01 * HALF_STEP, atol=leak * b.max() + 1e-30)
            assert level.level in empty or b.max() > 0.0


def test_a_texture_has_room_for_light_that_merging_adds_up() -> None:
    """Thin voxels that all shine: what a ray meets in two of them is twice as much."""
    where = layout()
    shapes = [(6,) + (level.resolution,) * 3 for level in where.levels]
    alphas = [np.full(shape, 2.0**-10) for shape in shapes]
    colors = [np.full((*shape, 3), 1.0) for shape in shapes]
    opacity, emittance = opacity_of(where, alphas), emittance_of(where, colors)
    found = packed_in_texture(opacity, emittance, SIX)
    expected = downsample_volume(opacity, emittance, DownsamplingConfig(), StorageConfig(), SIX)
    brightest = []
    for level in where.levels:
        ours, theirs = (np.array(unpack_level(each, level).emittance) for each in (found, expected))
        np.testing.assert_allclose(ours, theirs, rtol=2e-3)
        brightest.append(theirs.max())
    # Twice the brightest is what half precision has left without room.
    assert brightest[-1] > 4.0


def test_a_texture_of_nothing_is_nothing() -> None:
    opacity, emittance = voxels(layout(), empty=(0, 1, 2))
    found = packed_in_texture(opacity, emittance, SIX)
    for level in found.layout.levels:
        texels = unpack_level(found, level)
        assert not np.array(texels.emittance).any()
        assert not np.array(texels.opacity).any()


@pytest.mark.parametrize("level_count", [1, 2])
def test_voxels_without_light_are_dark(level_count: int) -> None:
    opacity, emittance = voxels(layout(level_count))
    dark = replace(emittance, levels=[dr.zeros(mi.Color3f, dr.width(c)) for c in emittance.levels])
    config, storage = DownsamplingConfig(), StorageConfig()
    found = downsample_volume(opacity, None, config, storage, keeps_empty=True)
    expected = downsample_volume(opacity, dark, config, storage, keeps_empty=True)
    np.testing.assert_array_equal(words(found), words(expected))


@pytest.mark.parametrize(
    ("config", "storage"),
    [
        (DownsamplingConfig(is_isotropic=True), StorageConfig()),
        (DownsamplingConfig(), StorageConfig(direction_count=3)),
        (DownsamplingConfig(), StorageConfig(format="float16")),
    ],
)
def test_other_formats_are_stored_as_before(
    config: DownsamplingConfig, storage: StorageConfig
) -> None:
    opacity, emittance = voxels(layout())
    merged, lit = downsample(opacity, emittance, config)
    assert lit is not None
    found = downsample_volume(opacity, emittance, config, storage)
    np.testing.assert_array_equal(words(found), words(pack_volume(merged, lit, storage)))


def test_takes_one_launch_a_level_and_one_for_all_words() -> None:
    where = layout()
    opacity, emittance = voxels(where)
    config, storage = DownsamplingConfig(), StorageConfig()
    downsample_volume(opacity, emittance, config, storage)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        downsample_volume(opacity, emittance, config, storage)
        launches = len(dr.kernel_history())
    # What a level gets from the finer one, all words, the corners, and two for what is empty.
    assert launches <= len(where.levels) - 1 + 1 + 1 + 2
