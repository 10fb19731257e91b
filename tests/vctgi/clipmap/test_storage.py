"""Packing keeps what it says: bytes, bounds, scale, directions, and nothing of empty levels."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from vctgi.clipmap import storage
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.sampling import read_medium, read_surface
from vctgi.clipmap.storage import (
    CODES,
    SCALED_FORMATS,
    StorageConfig,
    VoxelVolume,
    bytes_per_voxel,
    pack_volume,
    storage_in_use,
)
from vctgi.clipmap.stored_directions import SIX
from vctgi.clipmap.unpacking import unpack_level

pytestmark = pytest.mark.usefixtures("variant")

GATHERED = [name for name in CODES if name != "texture16"]
"""Formats that every back end has."""

ROUNDING = 2e-6
"""Relative; as for the codes alone, with a factor more for the scale."""


def layout() -> ClipmapLayout:
    return lay_out_clipmap((0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=2, resolution=8)


def packed(
    where: ClipmapLayout,
    alphas: list[np.ndarray],
    colors: list[np.ndarray],
    config: StorageConfig | None = None,
) -> VoxelVolume:
    return pack_volume(
        opacity_of(where, alphas), emittance_of(where, colors), config or StorageConfig()
    )


def unpacked(volume: VoxelVolume) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Opacities [direction, z, y, x] and emittances [.., 3] that a read meets."""
    alphas, colors = [], []
    for level in volume.layout.levels:
        texels = unpack_level(volume, level)
        shape = (6,) + (level.resolution,) * 3
        alphas.append(np.array(texels.opacity).astype(float).reshape(shape))
        colors.append(np.array(texels.emittance).T.astype(float).reshape(*shape, 3))
    return alphas, colors


def read_everywhere(volume: VoxelVolume, seed: int) -> list[np.ndarray]:
    """Both reads at random points inside and around the windows, on every level."""
    rng = np.random.default_rng(seed)
    count = 400
    levels = mi.UInt32(rng.integers(0, len(volume.layout.levels), count).astype(np.uint32))
    offsets = rng.uniform(-6.0, 6.0, (3, count))
    points = mi.Point3f(np.float32(np.array(volume.layout.centre)[:, None] + offsets))
    normals = rng.normal(size=(3, count))
    ways = mi.Vector3f(np.float32(normals / np.linalg.norm(normals, axis=0)))
    medium = read_medium(volume, levels, points, ways)
    radiance, opacity = read_surface(volume, levels, points, ways, mi.Bool(True))
    return [np.array(each) for each in (medium.extinction, medium.source, radiance, opacity)]


@pytest.mark.parametrize(
    ("name", "bytes_by_directions"),
    [
        ("float32", {6: 96, 3: 48, 1: 16}),
        ("float16", {6: 48, 3: 24, 1: 8}),
        ("texture16", {6: 48, 3: 24, 1: 8}),
        ("rgb10a2", {6: 32, 3: 16, 1: 8}),
        ("rgba8", {6: 24, 3: 12, 1: 4}),
        ("srgb8", {6: 24, 3: 12, 1: 4}),
    ],
)
def test_bytes_of_a_voxel(name: str, bytes_by_directions: dict[int, int]) -> None:
    for direction_count, expected in bytes_by_directions.items():
        config = StorageConfig(format=name, direction_count=direction_count)  # type: ignore[arg-type]
        assert bytes_per_voxel(config) == expected


@pytest.mark.parametrize("direction_count", [6, 3, 1])
@pytest.mark.parametrize("name", GATHERED)
def test_a_volume_takes_its_bytes_and_no_more(name: str, direction_count: int) -> None:
    where = layout()
    config = StorageConfig(format=name, direction_count=direction_count)  # type: ignore[arg-type]
    volume = packed(where, *random_values(where, 1), config)
    assert volume.byte_count == bytes_per_voxel(config) * where.voxel_count


@pytest.mark.parametrize("name", GATHERED)
@given(seed=st.integers(0, 2**32 - 1), exponent=st.integers(-40, 14))
def test_a_stored_volume_is_within_its_bound(name: str, seed: int, exponent: int) -> None:
    where = layout()
    alphas, colors = random_values(where, seed)
    colors = [2.0**exponent * c for c in colors]
    volume = packed(where, alphas, colors, StorageConfig(format=name))  # type: ignore[arg-type]
    found_alphas, found_colors = unpacked(volume)
    peak = max(float(np.float32(c).max()) for c in colors)
    scale = 2.0 ** math.ceil(math.log2(peak)) if name in SCALED_FORMATS else 1.0
    code = CODES[name]
    for alpha, color, found_alpha, found_color in zip(
        alphas, colors, found_alphas, found_colors, strict=True
    ):
        color = np.float32(color).astype(float)  # what the device was given
        slack = ROUNDING * np.maximum(color, found_color)
        bound = scale * code.emittance_error(color / scale)
        assert (np.abs(found_color - color) <= bound + slack).all()
        bound = code.opacity_error(alpha)
        assert (np.abs(found_alpha - alpha) <= bound + ROUNDING * alpha).all()
        # Nothing shines where nothing is.
        np.testing.assert_array_equal(found_alpha == 0.0, alpha == 0.0)
        assert not found_color[found_alpha == 0.0].any()


@given(peak=st.floats(2.0**-100, 2.0**100))
def test_the_scale_is_the_next_power_of_two(peak: float) -> None:
    where = layout()
    alphas, colors = random_values(where, 2)
    top = max(float(c.max()) for c in colors)
    colors = [c * (peak / top) for c in colors]
    volume = packed(where, alphas, colors, StorageConfig(format="rgba8"))
    assert volume.texels.scale is not None
    scale = float(volume.texels.scale[0])
    assert math.frexp(scale)[0] == 0.5
    largest = max(float(np.float32(c).max()) for c in colors)
    assert largest <= scale < 2.0 * largest


def test_a_chosen_scale_is_used_and_has_to_suffice() -> None:
    where = layout()
    alphas, colors = random_values(where, 2)
    peak = max(float(np.float32(c).max()) for c in colors)
    config = StorageConfig(format="srgb8", scale=3.0 * peak)
    volume = packed(where, alphas, colors, config)
    _, found = unpacked(volume)
    bound = 3.0 * peak * CODES["srgb8"].emittance_error(np.array([1.0 / 3.0]))[0]
    assert max(np.abs(f - c).max() for f, c in zip(found, colors, strict=True)) <= bound
    with pytest.raises(ValueError, match=r"StorageConfig\.scale is .* set it at least so large"):
        packed(where, alphas, colors, dataclasses.replace(config, scale=0.99 * peak))


def test_half_precision_refuses_what_would_be_infinite() -> None:
    where = layout()
    alphas, colors = random_values(where, 2)
    colors[0][...] = np.minimum(colors[0], 1.0) * 65504.0
    packed(where, alphas, colors, StorageConfig(format="float16"))
    with pytest.raises(ValueError, match=r'holds emittance up to 65504.*use "float32"'):
        packed(where, alphas, [1.1 * c for c in colors], StorageConfig(format="float16"))


@pytest.mark.parametrize(
    ("opacity", "emittance"),
    [(1.5, 0.0), (-0.1, 0.0), (np.nan, 0.0), (0.0, 1.0), (0.5, -1.0), (0.5, np.nan), (1.0, np.inf)],
)
@pytest.mark.parametrize("name", [name for name in GATHERED if name != "float32"])
def test_what_is_no_light_is_refused(name: str, opacity: float, emittance: float) -> None:
    where = layout()
    alphas, colors = random_values(where, 2)
    alphas[1][2, 3, 4, 5], colors[1][2, 3, 4, 5] = opacity, [0.0, emittance, 0.0]
    with pytest.raises(ValueError, match="cannot hold level 1"):
        packed(where, alphas, colors, StorageConfig(format=name))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"format": "rgb9e5"}, "format must be one of"),
        ({"direction_count": 2}, "direction_count must be 6, 3 or 1"),
        ({"scale": 1.0}, 'leave it None for "float32"'),
        ({"format": "rgba8", "scale": 0.0}, "normal number"),
        ({"format": "rgba8", "scale": math.nan}, "normal number"),
        ({"format": "rgba8", "scale": math.inf}, "normal number"),
    ],
)
def test_bad_settings_are_refused(bad: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        StorageConfig(**bad)  # type: ignore[arg-type]


def test_a_texture_needs_a_gpu(variant: str) -> None:
    if dr.backend_v(mi.Float) == dr.JitBackend.CUDA:
        pytest.skip("there is a GPU")
    where = layout()
    with pytest.raises(ValueError, match='set a CUDA variant, or use the format "float16"'):
        packed(where, *random_values(where, 2), StorageConfig(format="texture16"))


@pytest.mark.parametrize("is_gpu", [False, True])
@pytest.mark.parametrize("has_derivatives", [False, True])
def test_auto_is_a_texture_where_there_is_a_gpu_and_nothing_to_differentiate(
    has_derivatives: bool, is_gpu: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    backend = dr.JitBackend.CUDA if is_gpu else dr.JitBackend.LLVM
    fake = SimpleNamespace(backend_v=lambda _: backend, JitBackend=dr.JitBackend)
    monkeypatch.setattr(storage, "dr", fake)

    def in_use(level_count: int) -> str:
        where = lay_out_clipmap(
            (0.0, 0.0, 0.0), finest_voxel_size=0.1, level_count=level_count, resolution=256
        )
        auto = StorageConfig(format="auto")
        return storage_in_use(auto, where, SIX, has_derivatives=has_derivatives).format

    assert in_use(8) == ("texture16" if is_gpu and not has_derivatives else "float32")
    # Deeper than the deepest texture.
    assert in_use(12) == "float32"


def test_three_directions_hold_the_larger_of_two_sides() -> None:
    where = layout()
    alphas, colors = random_values(where, 7)
    found_alphas, found_colors = unpacked(
        packed(where, alphas, colors, StorageConfig(direction_count=3))
    )
    for before, found in zip([*alphas, *colors], [*found_alphas, *found_colors], strict=True):
        pairs = np.float32(before).reshape(3, 2, *before.shape[1:])
        np.testing.assert_array_equal(found, np.repeat(pairs.max(axis=1), 2, axis=0))


def test_one_direction_holds_the_mean_over_the_axes() -> None:
    where = layout()
    alphas, colors = random_values(where, 7)
    found_alphas, found_colors = unpacked(
        packed(where, alphas, colors, StorageConfig(direction_count=1))
    )
    for before, found in zip([*alphas, *colors], [*found_alphas, *found_colors], strict=True):
        mean = before.reshape(3, 2, *before.shape[1:]).max(axis=1).mean(axis=0)
        np.testing.assert_allclose(found, np.broadcast_to(mean, found.shape), rtol=ROUNDING)


@pytest.mark.parametrize("direction_count", [3, 1])
def test_fewer_directions_lose_nothing_of_what_is_alike(direction_count: int) -> None:
    where = layout()
    alphas, colors = random_values(where, 7)
    alphas = [np.repeat(a[:1], 6, axis=0) for a in alphas]
    colors = [np.repeat(c[:1], 6, axis=0) for c in colors]
    whole = packed(where, alphas, colors)
    reduced = packed(where, alphas, colors, StorageConfig(direction_count=direction_count))
    for a, b in zip(read_everywhere(whole, 3), read_everywhere(reduced, 3), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("direction_count", [6, 3, 1])
@pytest.mark.parametrize("name", GATHERED)
def test_levels_without_opacity_cost_one_voxel_and_read_as_nothing(
    name: str, direction_count: int
) -> None:
    # Both windows hold the world's origin, where the one stored voxel lies, too.
    where = lay_out_clipmap((0.4, -1.0, 1.0), finest_voxel_size=0.5, level_count=2, resolution=8)
    alphas, colors = random_values(where, 9)
    config = StorageConfig(format=name, direction_count=direction_count)  # type: ignore[arg-type]
    empty = {0, 2}
    for level in empty:
        alphas[level][...] = colors[level][...] = 0.0
    volume = packed(where, alphas, colors, config)
    held = sum(level.voxel_count for level in where.levels if level.level not in empty)
    assert volume.byte_count == bytes_per_voxel(config) * (held + len(empty))

    # One voxel, far from the points that are read, makes a level be stored whole.
    for level in empty:
        x, y, z = (o % where.levels[level].resolution for o in where.levels[level].origin)
        alphas[level][:, z, y, x] = 1.0
    whole = packed(where, alphas, colors, config)
    assert whole.byte_count == bytes_per_voxel(config) * where.voxel_count
    rng = np.random.default_rng(4)
    count = 300
    levels = rng.integers(0, len(where.levels), count)
    corner = np.array([where.levels[level].window_min for level in levels])
    size = np.array([where.levels[level].voxel_size for level in levels])[:, None]
    points = corner + size * rng.uniform(1.6, 10.0, (count, 3))
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    arguments = (
        mi.UInt32(levels.astype(np.uint32)),
        mi.Point3f(np.float32(points.T)),
        mi.Vector3f(np.float32(ways.T)),
    )
    for a, b in zip(
        _arrays(read_medium(volume, *arguments)),
        _arrays(read_medium(whole, *arguments)),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)
    for c, d in zip(
        read_surface(volume, *arguments, mi.Bool(True)),
        read_surface(whole, *arguments, mi.Bool(True)),
        strict=True,
    ):
        np.testing.assert_array_equal(np.array(c), np.array(d))


def _arrays(medium: object) -> list[np.ndarray]:
    return [np.array(value) for value in vars(medium).values()]


@pytest.mark.parametrize("name", GATHERED)
def test_a_volume_of_nothing_is_nothing(name: str) -> None:
    where = layout()
    alphas, colors = random_values(where, 1, empty_share=1.0)
    config = StorageConfig(format=name)  # type: ignore[arg-type]
    volume = packed(where, alphas, colors, config)
    assert volume.byte_count == bytes_per_voxel(config) * len(where.levels)
    assert not any(values.any() for values in read_everywhere(volume, 1))
