"""Linear float pictures -> 8-bit pictures embedded in a page."""

from __future__ import annotations

import base64
import io
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

NOT_FINITE = (255, 0, 255)
"""Magenta, which no colour map here contains: a pixel that is NaN or infinite."""

SCALE_QUANTILE = 0.99
"""The error map's scale is this quantile of the absolute error, rounded up to 1, 2 or 5 x 10^n."""

JPEG_QUALITY = 92
"""Of the small pictures where many stand side by side."""

VIEWER_MANTISSA_BITS = 7
"""Kept of half precision's ten for the exposure control: steps of 0.8 %, below one 8-bit code
around mid-grey, in two thirds of the size."""

REC709_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class SignedMap:
    """A signed error map."""

    uri: str
    scale: float
    """Error at either end of the colours; larger errors have the end's colour."""
    exceeding_share: float
    """Share of pixels beyond the scale."""


def finite_pixels(pixels: Floats) -> NDArray[np.bool_]:
    """Mask, [y, x], of the pixels whose channels are all finite."""
    return np.isfinite(pixels if pixels.ndim == 2 else pixels.sum(axis=-1, dtype=np.float64))


def luminance(pixels: Floats) -> Floats:
    """Rec. 709 luminance, [y, x], of [y, x, 3]; [y, x] is returned as it is."""
    return pixels if pixels.ndim == 2 else np.asarray(pixels @ REC709_LUMINANCE, dtype=np.float32)


def srgb_from_linear(linear: Floats, *, exposure: float) -> Bytes:
    """Scale by 2^exposure, clip to [0, 1], and encode with the sRGB curve (IEC 61966-2-1).

    No other tone curve, so that equal radiance looks equal in all pictures of a report.
    """
    scaled = np.clip(_as_rgb(linear) * np.float32(2.0**exposure), 0.0, 1.0)
    scaled = np.nan_to_num(scaled, nan=0.0)
    curve = np.where(
        scaled <= 0.0031308, 12.92 * scaled, 1.055 * np.maximum(scaled, 1e-8) ** (1 / 2.4) - 0.055
    )
    codes: Bytes = np.round(255.0 * curve).astype(np.uint8)
    codes[~finite_pixels(linear)] = NOT_FINITE
    return codes


def tone_mapped_uri(linear: Floats, *, exposure: float) -> str:
    """PNG data URI of `srgb_from_linear`."""
    return png_uri(Image.fromarray(srgb_from_linear(linear, exposure=exposure), mode="RGB"))


def thumbnail_uri(linear: Floats, *, exposure: float, width: int = 128) -> str:
    """PNG data URI of a version at most `width` pixels wide, box filtered in linear light."""
    return tone_mapped_uri(reduced(linear, width), exposure=exposure)


def reduced(linear: Floats, width: int) -> Floats:
    """Return a picture at most `width` pixels wide, the mean of whole blocks of pixels."""
    step = max(1, math.ceil(linear.shape[1] / width))
    rows = max(1, linear.shape[0] // step)
    columns = max(1, linear.shape[1] // step)
    cut = linear[: rows * step, : columns * step]
    shape = (rows, cut.shape[0] // rows, columns, cut.shape[1] // columns, *linear.shape[2:])
    small: Floats = cut.reshape(shape).mean(axis=(1, 3), dtype=np.float64).astype(np.float32)
    return small


def jpeg_uri(linear: Floats, *, exposure: float) -> str:
    """JPEG data URI of `srgb_from_linear`, a quarter of a PNG: to be looked at, not measured."""
    image = Image.fromarray(srgb_from_linear(linear, exposure=exposure), mode="RGB")
    buffer = io.BytesIO()
    image.save(buffer, format="JPEG", quality=JPEG_QUALITY, subsampling=0, optimize=True)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def error_scale(errors: Sequence[Floats]) -> float:
    """Return one scale for the signed maps of many errors: that of the median one.

    So one method that is wrong by a factor leaves the others' errors visible.
    """
    found = []
    for error in errors:
        signed = luminance(error)
        magnitude = np.abs(signed[np.isfinite(signed)])
        found.append(float(np.quantile(magnitude, SCALE_QUANTILE)) if magnitude.size else 0.0)
    return _round_up(float(np.median(found)))


def signed_map(error: Floats, scale: float | None = None) -> SignedMap:
    """Diverging picture of the luminance of an error: red too bright, blue too dark, white none.

    Parameters
    ----------
    error
        [y, x, 3] or [y, x].
    scale
        Error at either end of the colours; None: from the errors themselves.
    """
    signed = luminance(error)
    finite = np.isfinite(signed)
    magnitude = np.abs(signed[finite])
    scale = error_scale([error]) if scale is None else scale
    exceeding = float(np.mean(magnitude > scale)) if magnitude.size else 0.0
    position = 0.5 + 0.5 * signed / scale
    return SignedMap(uri=_mapped_uri(position, "RdBu_r"), scale=scale, exceeding_share=exceeding)


def sequential_uri(values: Floats, *, low: float, high: float, colours: str) -> str:
    """PNG data URI of one channel from `low` to `high` in a matplotlib colour map."""
    span = high - low if high > low else 1.0
    return _mapped_uri((luminance(values) - low) / span, colours)


def normal_uri(normal: Floats) -> str:
    """PNG data URI of unit vectors, each component from -1 (0) to 1 (255)."""
    codes = np.round(255.0 * np.clip(0.5 + 0.5 * np.nan_to_num(_as_rgb(normal)), 0.0, 1.0))
    codes = codes.astype(np.uint8)
    codes[~finite_pixels(normal)] = NOT_FINITE
    return png_uri(Image.fromarray(codes, mode="RGB"))


def colour_stops(colours: str, count: int = 17) -> list[str]:
    """Evenly spaced colours of a matplotlib colour map, as `#rrggbb`, for a colour bar."""
    return [
        mpl.colors.to_hex(colour) for colour in mpl.colormaps[colours](np.linspace(0, 1, count))
    ]


def linear_payload(linear: Floats) -> str:
    """Linear RGB for the viewer's exposure control: base64 of deflated half-precision numbers.

    Layout before deflating (zlib): for each channel R, G, B, the high bytes of all pixels, then
    the low bytes; row by row. Values are rounded to `VIEWER_MANTISSA_BITS`; values above the
    largest half-precision number (65504) become that number.
    """
    limited = np.clip(_as_rgb(linear), -65504.0, 65504.0)
    bits = limited.astype(np.float16).view(np.uint16).astype(np.uint32)
    dropped = 10 - VIEWER_MANTISSA_BITS
    # Rounds half up; a carry out of the mantissa moves into the exponent, which is right, except
    # that it must not reach infinity.
    is_number = (bits & 0x7C00) != 0x7C00
    rounded = (bits + (1 << (dropped - 1))) >> dropped << dropped
    overflows = (rounded & 0x7C00) == 0x7C00
    bits = np.where(is_number & ~overflows, rounded, bits >> dropped << dropped)
    # NaN keeps its quiet bit, the mantissa's highest, so that dropping low bits keeps it NaN.
    planes = np.moveaxis(bits.astype(np.uint16), -1, 0).reshape(3, -1)
    octets = np.stack([planes >> 8, planes & 0xFF], axis=1).astype(np.uint8)
    return base64.b64encode(zlib.compress(octets.tobytes(), 9)).decode("ascii")


def _as_rgb(pixels: Floats) -> Floats:
    return np.repeat(pixels[..., None], 3, axis=-1) if pixels.ndim == 2 else pixels


def _mapped_uri(position: Floats, colours: str) -> str:
    """Index image into a 255-colour palette (odd, so that a diverging map has a middle)."""
    finite = np.isfinite(position)
    clipped = np.clip(np.where(finite, position, 0.0), 0.0, 1.0)
    index = np.round(254.0 * clipped).astype(np.uint8)
    index[~finite] = 255
    table = mpl.colormaps[colours](np.linspace(0.0, 1.0, 255))[:, :3]
    palette = np.vstack([np.round(255.0 * table), [NOT_FINITE]]).astype(np.uint8)
    image = Image.fromarray(index, mode="P")
    image.putpalette(palette.tobytes())
    return png_uri(image)


def png_uri(image: Image.Image) -> str:
    """PNG data URI of an 8-bit picture."""
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _round_up(value: float) -> float:
    """Next of 1, 2, 5 x 10^n; 1 for zero, whose picture is white at any scale."""
    if value <= 0.0:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(value))
    return next(
        step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value * 0.999999
    )
