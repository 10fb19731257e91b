"""Voxels in a texture: stacked, padded, clamped, and equal to voxels in arrays within a bound.

Without a GPU the texture units are emulated, which tests every address and all of the clamping; on
a GPU the same tests meet the units themselves and their coarse weights.
"""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from vctgi.clipmap.formats import MAX_HALF, LevelTexels
from vctgi.clipmap.levels import ClipmapLayout, LevelLayout, lay_out_clipmap
from vctgi.clipmap.neighbourhood import Layer, neighbourhood, scaled
from vctgi.clipmap.reduction import reduce_directions
from vctgi.clipmap.sampling import OPTICAL_DEPTH_CAP, read_medium, read_surface
from vctgi.clipmap.storage import StorageConfig, VoxelVolume, pack_volume
from vctgi.clipmap.stored_directions import directions_of
from vctgi.clipmap.texture import TextureTexels
from vctgi.clipmap.texture_target import (
    MAX_TEXTURE_DEPTH,
    build_texture,
    stack_slabs,
    texture_scale,
)
from vctgi.maths.stub_gaps import as_component

pytestmark = pytest.mark.usefixtures("variant")

HALF_ROUNDING = 2.0**-11
"""Relative. A texture unit may round what it returns to half precision."""

LARGEST = 2.0
"""Bound of what `random_values` makes: the difference of two neighbours cannot be larger."""


def layout() -> ClipmapLayout:
    return lay_out_clipmap((0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=2, resolution=8)


def both(direction_count: int, empty: tuple[int, ...] = ()) -> tuple[VoxelVolume, VoxelVolume]:
    """Return the same voxels in a texture and in arrays of half precision."""
    where = layout()
    alphas, colors = random_values(where, 5)
    for level in empty:
        alphas[level][...] = colors[level][...] = 0.0
    opacity, emittance = opacity_of(where, alphas), emittance_of(where, colors)

    def texels_of(level: LevelLayout) -> LevelTexels:
        texels = LevelTexels(emittance.levels[level.level], opacity.levels[level.level], 6)
        return reduce_directions(texels, direction_count)

    is_empty = [level in empty for level in range(len(where.levels))]
    scale = texture_scale(mi.Float(LARGEST), merge_count=0)
    directions = directions_of(direction_count)
    texture = build_texture(where.levels, is_empty, texels_of, directions, scale)
    config = StorageConfig(format="float16", direction_count=direction_count)
    arrays = pack_volume(opacity, emittance, config)
    return VoxelVolume(where, arrays.table, texture), arrays


def weight_error(volume: VoxelVolume) -> float:
    assert isinstance(volume.texels, TextureTexels)
    return volume.texels.weight_error()


def layer_values(volume: VoxelVolume, level: int, q: np.ndarray, layer: Layer) -> np.ndarray:
    """Interpolated values of a layer, [4, point], at points in voxels from voxel centre 0."""
    point = mi.Point3f(np.ascontiguousarray(q.T, dtype=np.float32))
    around = neighbourhood(volume.table, dr.full(mi.UInt32, level, len(q)), point)
    total = mi.Vector4f(0.0)
    for weight_u, weight_v, tap in volume.texels.taps(around, layer):
        total = dr.fma(as_component(weight_u * weight_v), tap, total)
    color = scaled(volume.texels, mi.Color3f(total.x, total.y, total.z))
    return np.array(mi.Vector4f(color.x, color.y, color.z, total.w))


def random_layer(
    window: LevelLayout, axis: int, rng: np.random.Generator, count: int
) -> tuple[np.ndarray, Layer]:
    """Points up to two voxels around a window, some at the very centres of voxels, and layers.

    A layer is one of the two around its point, and within the window.
    """
    q = window.origin + rng.uniform(-2.5, window.resolution + 1.5, (count, 3))
    held = window.origin[axis] + rng.integers(0, window.resolution, count)
    q[:, axis] = held + rng.uniform(-1.0, 1.0, count)
    q[::4] = np.round(q[::4])
    q = q.astype(np.float32)
    held = np.clip(held, np.floor(q[:, axis]), np.floor(q[:, axis]) + 1)
    side = rng.integers(0, 2, count)
    layer = Layer(axis, mi.UInt32(side.astype(np.uint32)), mi.Float(held.astype(np.float32)))
    return q, layer


@pytest.mark.parametrize("direction_count", [6, 3, 1])
def test_a_layer_equals_that_of_the_arrays(direction_count: int) -> None:
    texture, arrays = both(direction_count)

    @given(seed=st.integers(0, 2**32 - 1), level=st.integers(0, 2), axis=st.integers(0, 2))
    def holds(seed: int, level: int, axis: int) -> None:
        window = texture.layout.levels[level]
        q, layer = random_layer(window, axis, np.random.default_rng(seed), 64)
        found = layer_values(texture, level, q, layer)
        expected = layer_values(arrays, level, q, layer)
        bound = weight_error(texture) * LARGEST + HALF_ROUNDING * expected
        assert (np.abs(found - expected) <= bound).all()
        # Outside by a voxel or more across the axis there is nothing, not even a rounding.
        low, high = np.array(window.origin) - 1.0, np.array(window.origin) + window.resolution
        is_outside = (q <= low) | (q >= high)
        is_outside[:, axis] = False
        assert not found[:, is_outside.any(axis=1)].any()

    holds()


def test_a_level_without_opacity_is_nothing_and_leaves_the_others_as_they_are() -> None:
    empty = 1
    texture, _ = both(6, empty=(empty,))
    whole, _ = both(6)
    assert texture.byte_count < whole.byte_count
    rng = np.random.default_rng(3)
    for window in texture.layout.levels:
        for axis in range(3):
            q, layer = random_layer(window, axis, rng, 64)
            found = layer_values(texture, window.level, q, layer)
            if window.level == empty:
                assert not found.any()
                continue
            expected = layer_values(whole, window.level, q, layer)
            bound = 2.0 * weight_error(whole) * LARGEST + HALF_ROUNDING * expected
            assert (np.abs(found - expected) <= bound).all()


def test_the_medium_is_that_of_the_arrays() -> None:
    texture, arrays = both(6)
    rng = np.random.default_rng(8)
    count = 500
    levels = mi.UInt32(rng.integers(0, 3, count).astype(np.uint32))
    offsets = rng.uniform(-6.0, 6.0, (3, count))
    points = mi.Point3f(np.float32(np.array(texture.layout.centre)[:, None] + offsets))
    ways = rng.normal(size=(3, count))
    directions = mi.Vector3f(np.float32(ways / np.linalg.norm(ways, axis=0)))
    found, expected = (read_medium(v, levels, points, directions) for v in (texture, arrays))
    # The slope of the optical depth is at most e^6, its value at the cap's opacity; three axes
    # share it by |d_k| <= sqrt(3) in all, over voxels of 0.5 and more.
    slope = np.sqrt(3.0) * np.exp(OPTICAL_DEPTH_CAP) / 0.5
    error = np.abs(np.array(found.extinction) - np.array(expected.extinction))
    assert (error <= slope * (weight_error(texture) + HALF_ROUNDING)).all()
    assert np.median(error) <= 4.0 * (weight_error(texture) + HALF_ROUNDING)


def test_weights_are_those_of_an_8_bit_fraction_on_a_gpu_and_single_precision_elsewhere() -> None:
    texture, _ = both(6)
    is_gpu = dr.backend_v(mi.Float) == dr.JitBackend.CUDA
    depth = 6 * (10 + 10 + 6)
    rounding = 2.5 * 2.0**-24 * (depth + 8 + 8)
    assert weight_error(texture) == pytest.approx(3 * 2.0**-9 * is_gpu + rounding)


def test_volumes_in_textures_can_be_recorded() -> None:
    levels = dr.zeros(mi.UInt32, 8)
    ways = mi.Vector3f(dr.full(mi.Float, 1.0, 8), 0.0, 0.0)

    def read(volume: VoxelVolume, points: mi.Point3f, active: mi.Bool) -> tuple[mi.Float, mi.Float]:
        # Masked fetches are what a recording cannot hold.
        _, opacity = read_surface(volume, levels, points, ways, active)
        return read_medium(volume, levels, points, ways).extinction, opacity

    recorded = dr.freeze(read)
    found = []
    for direction_count, shift in ((6, 0.0), (6, 0.3), (3, 0.6), (6, 0.6)):
        texture, _ = both(direction_count)
        away = dr.arange(mi.Float, 8) * 0.2 + shift
        x, y, z = texture.layout.centre
        points = mi.Point3f(x + away, y + away, z - away)
        active = away > 0.5
        dr.eval(points, active)
        expected = read(texture, points, active)
        arrays = recorded(texture, points, active)
        for ours, theirs in zip(arrays, expected, strict=True):
            np.testing.assert_array_equal(np.array(ours), np.array(theirs))
        found.append(np.array(arrays[0]))
    assert not np.array_equal(found[0], found[3])


@given(peak=st.floats(2.0**-100, 2.0**100), merge_count=st.integers(0, 14))
def test_the_scale_leaves_room_for_merged_voxels_and_no_more(peak: float, merge_count: int) -> None:
    top = float(np.float32(peak))
    scale = float(texture_scale(mi.Float(top), merge_count)[0])
    assert math.frexp(scale)[0] == 0.5
    assert MAX_HALF / 4.0 < top * 2.0**merge_count / scale <= MAX_HALF / 1.99


def test_the_scale_of_nothing_is_a_number() -> None:
    assert float(texture_scale(mi.Float(0.0), 3)[0]) == 1.0


def test_slabs_stand_one_behind_the_other() -> None:
    starts, depth = stack_slabs([64, 64, 32], 6)
    assert starts == [0, 6 * 66, 12 * 66]
    assert depth == 12 * 66 + 6 * 34


def test_the_largest_clipmap_fits_and_a_larger_one_is_refused() -> None:
    def edges(level_count: int) -> list[int]:
        where = lay_out_clipmap(
            (0.0, 0.0, 0.0), finest_voxel_size=0.1, level_count=level_count, resolution=256
        )
        return [level.resolution for level in where.levels]

    assert stack_slabs(edges(8), 6)[1] <= MAX_TEXTURE_DEPTH
    with pytest.raises(ValueError, match="layers, and a texture holds 16384: use fewer"):
        stack_slabs(edges(12), 6)
    assert stack_slabs(edges(12), 3)[1] <= MAX_TEXTURE_DEPTH
