from __future__ import annotations

import base64
import io
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from reports.pictures import (
    NOT_FINITE,
    VIEWER_MANTISSA_BITS,
    linear_payload,
    normal_uri,
    sequential_uri,
    signed_map,
    srgb_from_linear,
    thumbnail_uri,
    tone_mapped_uri,
)

HALF_STEP = 2.0 ** -(VIEWER_MANTISSA_BITS + 1)
"""Largest relative change by rounding to that many bits behind the leading one."""
HALF_SMALLEST_NORMAL = 2.0**-14


def decoded(uri: str) -> NDArray[np.uint8]:
    octets = base64.b64decode(uri.removeprefix("data:image/png;base64,"))
    return np.asarray(Image.open(io.BytesIO(octets)).convert("RGB"))


def pixel_row(*values: float) -> NDArray[np.float32]:
    return np.array([values], np.float32)


def test_the_srgb_curve_has_its_known_values() -> None:
    # IEC 61966-2-1: linear 0.214041 is code 127.5, 0.0031308 the end of the straight part.
    codes = srgb_from_linear(pixel_row(0.0, 0.2140, 0.0031308, 1.0, 7.0, -1.0), exposure=0.0)
    assert codes[0, :, 0].tolist() == [0, 127, 10, 255, 255, 0]


def test_one_stop_doubles() -> None:
    pixels = np.random.default_rng(0).random((5, 5, 3), np.float32)
    np.testing.assert_array_equal(
        srgb_from_linear(pixels, exposure=1.0), srgb_from_linear(2 * pixels, exposure=0.0)
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_pixel_that_is_not_finite_is_magenta_everywhere(bad: float) -> None:
    one = pixel_row(0.5, bad)
    rgb = np.full((1, 2, 3), 0.5, np.float32)
    rgb[0, 1, 2] = bad
    pictures = [
        decoded(tone_mapped_uri(rgb, exposure=0.0)),
        decoded(normal_uri(rgb)),
        decoded(signed_map(one).uri),
        decoded(sequential_uri(one, low=0.0, high=1.0, colours="magma")),
    ]
    for picture in pictures:
        assert tuple(picture[0, 1]) == NOT_FINITE
        assert tuple(picture[0, 0]) != NOT_FINITE


def test_no_error_is_the_neutral_middle() -> None:
    drawn = decoded(signed_map(pixel_row(-1.0, 0.0, 1.0)).uri)[0].astype(int)
    dark, none, bright = drawn
    assert none.min() > 240
    assert dark[2] > dark[0]
    assert bright[0] > bright[2]


def test_an_error_map_mirrors_with_its_sign() -> None:
    error = np.random.default_rng(3).normal(size=(16, 16)).astype(np.float32)
    assert signed_map(error).scale == signed_map(-error).scale


def test_the_scale_is_a_round_number_that_few_pixels_exceed() -> None:
    drawn = signed_map(np.linspace(-0.031, 0.031, 1000, dtype=np.float32).reshape(10, 100))
    assert drawn.scale == pytest.approx(0.05)
    assert drawn.exceeding_share == 0.0
    outlier = np.zeros((100, 100), np.float32)
    outlier[0, :50] = 9.0
    outlier[1:3] = 0.2
    assert signed_map(outlier).scale == pytest.approx(0.2)
    assert signed_map(outlier).exceeding_share == pytest.approx(0.005)


def test_a_picture_equal_to_its_reference_has_a_map() -> None:
    assert decoded(signed_map(np.zeros((3, 3, 3), np.float32)).uri).min() > 240


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 12))
def test_a_thumbnail_of_a_plain_picture_is_plain(width: int, height: int, limit: int) -> None:
    pixels = np.full((height, width, 3), 0.3, np.float32)
    small = decoded(thumbnail_uri(pixels, exposure=0.0, width=limit))
    assert small.shape[1] <= limit
    assert (small == srgb_from_linear(pixels, exposure=0.0)[0, 0]).all()


def unpacked(payload: str, height: int, width: int) -> NDArray[np.float64]:
    octets = np.frombuffer(zlib.decompress(base64.b64decode(payload)), np.uint8)
    planes = octets.reshape(3, 2, height * width).astype(np.uint16)
    halves = ((planes[:, 0] << 8) | planes[:, 1]).view(np.float16)
    return np.moveaxis(halves.reshape(3, height, width), 0, -1).astype(np.float64)


@given(st.lists(st.floats(HALF_SMALLEST_NORMAL, 60000.0, width=32), min_size=1, max_size=20))
def test_linear_values_keep_their_precision(values: list[float]) -> None:
    pixels = np.repeat(pixel_row(*values)[..., None], 3, axis=-1)
    read = unpacked(linear_payload(pixels), 1, len(values))
    # A second rounding: half precision itself, 2^-11.
    np.testing.assert_allclose(read, pixels, rtol=HALF_STEP + 2.0**-11)


def test_linear_values_keep_sign_black_and_what_is_no_number() -> None:
    pixels = pixel_row(0.0, -1.0, np.nan, 1e9, -1e9)
    read = unpacked(linear_payload(pixels), 1, 5)[0, :, 0]
    assert read[:2].tolist() == [0.0, -1.0]
    assert np.isnan(read[2])
    assert np.isfinite(read[3:]).all()
    assert read[3] == -read[4] > 60000.0
