"""Every code of texels keeps to its stated error, at 0 and 1 exactly, and makes no light."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctgi.clipmap.formats import MAX_HALF, MIN_HALF, LevelTexels, TexelCode, VoxelAddress
from vctgi.clipmap.integer_formats import linear_from_srgb, srgb_from_linear
from vctgi.clipmap.storage import CODES, SCALED_FORMATS

pytestmark = pytest.mark.usefixtures("variant")

FORMATS = [name for name in CODES if name != "texture16"]
"""Formats by name; a texture holds the same numbers as float16."""

ROUNDING = 2e-6
"""Relative. The transfer curve is a power in single precision, up to some ten units in the last
place on a GPU, there and back; so is the code's own product."""

VOXELS = 64
"""Voxels of a test's level, so that every example runs the same kernels."""


def recode(
    code: TexelCode, emittance: np.ndarray, opacity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Code and decode emittances [direction, voxel, 3] and opacities [direction, voxel]."""
    direction_count, voxel_count = opacity.shape
    color = np.ascontiguousarray(np.float32(emittance).reshape(-1, 3).T)
    texels = LevelTexels(mi.Color3f(color), mi.Float(np.float32(opacity).ravel()), direction_count)
    # A level that does not begin at word 0, between words that must stay as they are.
    slabs = code.slab_count(direction_count)
    words = code.allocate(slabs * (voxel_count + 2))
    code.encode(words, slabs, texels)
    assert not np.array(words)[: words_of(code, slabs)].any()
    assert not np.array(words)[-words_of(code, slabs) :].any()

    lane = np.arange(direction_count * voxel_count, dtype=np.uint32)
    place, slot = mi.UInt32(lane % voxel_count), mi.UInt32(lane // voxel_count)
    voxel = VoxelAddress(mi.UInt32(slabs), mi.UInt32(voxel_count), place)
    found = np.array(code.fetch(words, voxel, slot, direction_count, True)).T
    shape = (direction_count, voxel_count)
    return found[:, :3].reshape(*shape, 3).astype(float), found[:, 3].reshape(shape).astype(float)


def words_of(code: TexelCode, count: int) -> int:
    """Array elements of some words."""
    return count * code.word_bytes // code.allocate(1).numpy().itemsize


def max_emittance(name: str) -> float:
    return 1.0 if name in SCALED_FORMATS else MAX_HALF


def values(name: str, seed: int, direction_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Emittances over 12 orders of magnitude, and opacities, with what lies at the ends."""
    rng = np.random.default_rng(seed)
    shape = (direction_count, VOXELS)
    emittance = max_emittance(name) * 10.0 ** rng.uniform(-12.0, 0.0, (*shape, 3))
    emittance[:, :6] = (
        max_emittance(name) * np.array([1.0, 0.5, 0.0, 1e-3, 0.0031308, 0.04])[:, None]
    )
    opacity = rng.uniform(0.0, 1.0, shape)
    opacity[:, 8:24] = rng.integers(0, 65, (direction_count, 16)) / 64.0
    opacity[:, 24:40] = 10.0 ** rng.uniform(-9.0, 0.0, (direction_count, 16))
    opacity[:, 40:46] = [1.0, 0.0, 1e-30, 0.5 / 255, 0.5 / 1023, 1.0 - 0.5 / 255]
    opacity[:, :3] = 1.0
    emittance[opacity == 0.0] = 0.0
    return np.float32(emittance).astype(float), np.float32(opacity).astype(float)


@pytest.mark.parametrize("direction_count", [6, 3, 1])
@pytest.mark.parametrize("name", FORMATS)
@given(seed=st.integers(0, 2**32 - 1))
def test_values_move_within_the_stated_bound(name: str, direction_count: int, seed: int) -> None:
    code = CODES[name]
    emittance, opacity = values(name, seed, direction_count)
    found, found_opacity = recode(code, emittance, opacity)
    for before, after, bound in [
        (emittance, found, code.emittance_error(emittance)),
        (opacity, found_opacity, code.opacity_error(opacity)),
    ]:
        assert (np.abs(after - before) <= bound + ROUNDING * np.maximum(before, after)).all()


@pytest.mark.parametrize("name", FORMATS)
@given(seed=st.integers(0, 2**32 - 1))
def test_opacity_stays_in_range_and_keeps_its_ends(name: str, seed: int) -> None:
    emittance, opacity = values(name, seed, 6)
    found, found_opacity = recode(CODES[name], emittance, opacity)
    assert (found_opacity[opacity == 1.0] == 1.0).all()
    np.testing.assert_array_equal(found_opacity == 0.0, opacity == 0.0)
    assert (found_opacity <= 1.0).all()
    assert (found >= 0.0).all()
    # No light without a surface that it comes from.
    assert not found[found_opacity == 0.0].any()


@pytest.mark.parametrize("name", FORMATS)
def test_the_scale_itself_is_not_clipped(name: str) -> None:
    top = max_emittance(name)
    found, _ = recode(CODES[name], np.full((6, VOXELS, 3), top), np.ones((6, VOXELS)))
    np.testing.assert_allclose(found, top, rtol=ROUNDING)


def test_single_precision_is_kept_to_the_bit() -> None:
    emittance, opacity = values("float32", 3, 6)
    found, found_opacity = recode(CODES["float32"], emittance, opacity)
    np.testing.assert_array_equal(found, emittance)
    np.testing.assert_array_equal(found_opacity, opacity)


def test_half_precision_rounds_as_ieee_754_says() -> None:
    emittance, opacity = values("float16", 4, 6)
    found, found_opacity = recode(CODES["float16"], emittance, opacity)
    np.testing.assert_array_equal(found, np.float16(emittance))
    expected = np.where(opacity > 0.0, np.maximum(np.float16(opacity), MIN_HALF), 0.0)
    np.testing.assert_array_equal(found_opacity, expected)


@pytest.mark.parametrize(("name", "steps"), [("rgb10a2", 1023), ("rgba8", 255), ("srgb8", 255)])
def test_each_code_of_opacity_is_met(name: str, steps: int) -> None:
    opacity = np.arange(6 * VOXELS).reshape(6, VOXELS) % (steps + 1) / steps
    _, found = recode(CODES[name], np.zeros((6, VOXELS, 3)), opacity)
    np.testing.assert_array_equal(np.round(found * steps), np.round(opacity * steps))


def test_the_transfer_curve_is_inverted_and_keeps_its_ends() -> None:
    ends = [0.0, 1.0, 0.0031308]
    linear = np.concatenate([ends, np.linspace(0.0, 1.0, 1001)]).astype(np.float32)
    encoded = srgb_from_linear(mi.Color3f(mi.Float(linear)))
    # Closed form at a middle grey, from the standard's curve: 1.055 * 0.2140411^(1/2.4) - 0.055.
    grey = srgb_from_linear(mi.Color3f(0.2140411))
    assert float(grey.x[0]) == pytest.approx(0.5, abs=1e-6)
    back = np.array(linear_from_srgb(encoded))[0]
    np.testing.assert_allclose(back, linear, rtol=1e-5, atol=1e-7)
    assert np.array(encoded)[0, 0] == 0.0
    assert np.array(encoded)[0, 1] == pytest.approx(1.0, abs=ROUNDING)


@pytest.mark.parametrize(
    ("name", "value", "bound"),
    [
        ("rgb10a2", 1.0, 1.12e-3),
        ("rgb10a2", 0.0, 3.8e-5),
        ("srgb8", 1.0, 4.5e-3),
        ("srgb8", 0.0, 1.6e-4),
        ("srgb8", 1.0 / 330.0, 0.052 / 330.0),
        ("rgba8", 0.5, 1.97e-3),
    ],
)
def test_bounds_are_what_the_docstrings_say(name: str, value: float, bound: float) -> None:
    assert CODES[name].emittance_error(np.array([value]))[0] <= bound
