"""Codes of texels in integers: bytes, and the talk's words of ten bits a channel.

Emittance is in units of the storage scale, so that 1 is the largest that there is. Colour can be
coded by the sRGB transfer curve, whose steps are fine where the eye and a wide range of light need
them; opacity is always linear.

References
----------
[IEC61966] IEC 61966-2-1:1999, Default RGB colour space - sRGB.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.formats import LevelTexels, VoxelAddress
from vctgi.maths.stub_gaps import as_component

if TYPE_CHECKING:
    from vctgi.clipmap.formats import Words

OPACITIES_PER_WORD = 3
"""Opacities of ten bits in a word of `PackedCode`."""

SRGB_LINEAR_BELOW = 0.0031308
"""Linear value below which the sRGB curve is a straight line of slope `SRGB_SLOPE`."""

SRGB_SLOPE, SRGB_OFFSET, SRGB_EXPONENT = 12.92, 0.055, 2.4
"""Constants of the sRGB curve."""


@dataclass(frozen=True)
class ByteCode:
    """Four bytes a texel in one word, colour linear or sRGB-encoded, opacity linear.

    The largest error of a linear code is half its step, 1/510 of the scale; that of an sRGB code is
    half its step times the slope of the transfer curve, from 1.5e-4 of the scale near 0 to 4.5e-3
    at the scale, which is between 0.47 % and 5 % of any emittance above 1/330 of the scale.
    Opacity moves by 1/510 at most, and below that to 1/255.
    """

    is_srgb: bool

    @property
    def word_bytes(self) -> int:
        """Bytes of a texel."""
        return 4

    @property
    def max_emittance(self) -> float:
        """Return the storage scale."""
        return 1.0

    def slab_count(self, direction_count: int) -> int:
        """One texel for each direction."""
        return direction_count

    def allocate(self, count: int) -> mi.UInt32:
        """Return `count` texels of zeros."""
        return dr.zeros(mi.UInt32, count)

    def encode(self, words: Words, first: int, texels: LevelTexels) -> None:
        """Write red into the lowest byte and opacity into the highest."""
        color = srgb_from_linear(texels.emittance) if self.is_srgb else texels.emittance
        word = _opacity_code(texels.opacity, 255) << 24
        for channel in range(3):
            word |= _code(mi.Float(color[channel]), 255) << (8 * channel)
        dr.scatter(words, word, dr.arange(mi.UInt32, dr.width(texels.opacity)) + first)

    def fetch(
        self,
        words: Words,
        voxel: VoxelAddress,
        slot: mi.UInt32 | int,
        direction_count: int,
        active: mi.Bool | bool,
    ) -> mi.Vector4f:
        """Read a texel by one load."""
        word = dr.gather(mi.UInt32, words, voxel.word(slot), active)
        color = mi.Color3f([_value(word >> (8 * channel), 255) for channel in range(3)])
        if self.is_srgb:
            color = linear_from_srgb(color)
        return mi.Vector4f(color.x, color.y, color.z, as_component(_value(word >> 24, 255)))

    def emittance_error(self, emittance: np.ndarray) -> np.ndarray:
        """Half a step, times the slope of the transfer curve."""
        return _srgb_error(emittance, 255) if self.is_srgb else np.full_like(emittance, 0.5 / 255)

    def opacity_error(self, opacity: np.ndarray) -> np.ndarray:
        """Half a step, or a whole one where it would have become 0."""
        return _opacity_error(opacity, 255)


@dataclass(frozen=True)
class PackedCode:
    """The talk's words: ten bits a channel.

    One word of sRGB-encoded colour for each direction, whose last two bits are unused, and one word
    of three opacities for each three directions: of the six, one word for travel towards +x +y +z
    and one for -x -y -z. The largest error of emittance is 3.8e-5 of the scale near 0 and 1.1e-3 at
    the scale; opacity moves by 1/2046 at most, and below that to 1/1023.

    References
    ----------
    [Panteleev2014], slides on voxel formats.
    """

    @property
    def word_bytes(self) -> int:
        """Bytes of a word."""
        return 4

    @property
    def max_emittance(self) -> float:
        """Return the storage scale."""
        return 1.0

    def slab_count(self, direction_count: int) -> int:
        """Colour of each direction, then the opacities."""
        return direction_count + -(-direction_count // OPACITIES_PER_WORD)

    def allocate(self, count: int) -> mi.UInt32:
        """Return `count` words of zeros."""
        return dr.zeros(mi.UInt32, count)

    def encode(self, words: Words, first: int, texels: LevelTexels) -> None:
        """Write a slab of colours for each direction, then the slabs of opacities."""
        direction_count = texels.direction_count
        count = dr.width(texels.opacity)
        voxel_count = count // direction_count
        color = srgb_from_linear(texels.emittance)
        word = mi.UInt32(0)
        for channel in range(3):
            word |= _code(mi.Float(color[channel]), 1023) << (10 * channel)
        dr.scatter(words, word, dr.arange(mi.UInt32, count) + first)

        voxel = dr.arange(mi.UInt32, voxel_count)
        for slab in range(direction_count, self.slab_count(direction_count)):
            word = mi.UInt32(0)
            for slot in range(direction_count):
                where, shift = _opacity_place(slot, direction_count)
                if where == slab:
                    alpha = dr.gather(mi.Float, texels.opacity, voxel + slot * voxel_count)
                    word |= _opacity_code(alpha, 1023) << shift
            dr.scatter(words, word, voxel + (first + slab * voxel_count))

    def fetch(
        self,
        words: Words,
        voxel: VoxelAddress,
        slot: mi.UInt32 | int,
        direction_count: int,
        active: mi.Bool | bool,
    ) -> mi.Vector4f:
        """Read a texel by two loads."""
        word = dr.gather(mi.UInt32, words, voxel.word(slot), active)
        color = linear_from_srgb(
            mi.Color3f([_value(word >> (10 * channel), 1023) for channel in range(3)])
        )
        slab, shift = _opacity_place(slot, direction_count)
        opacities = dr.gather(mi.UInt32, words, voxel.word(slab), active)
        return mi.Vector4f(
            color.x, color.y, color.z, as_component(_value(opacities >> shift, 1023))
        )

    def emittance_error(self, emittance: np.ndarray) -> np.ndarray:
        """Half a step, times the slope of the transfer curve."""
        return _srgb_error(emittance, 1023)

    def opacity_error(self, opacity: np.ndarray) -> np.ndarray:
        """Half a step, or a whole one where it would have become 0."""
        return _opacity_error(opacity, 1023)


def srgb_from_linear(linear: mi.Color3f) -> mi.Color3f:
    """Encode colour in [0, 1] by the sRGB curve [IEC61966]; 0 and 1 stay."""
    curved = (1.0 + SRGB_OFFSET) * linear ** (1.0 / SRGB_EXPONENT) - SRGB_OFFSET
    return dr.select(linear <= SRGB_LINEAR_BELOW, SRGB_SLOPE * linear, curved)


def linear_from_srgb(encoded: mi.Color3f) -> mi.Color3f:
    """Decode colour in [0, 1] by the sRGB curve [IEC61966]; inverts `srgb_from_linear`."""
    curved = ((encoded + SRGB_OFFSET) / (1.0 + SRGB_OFFSET)) ** SRGB_EXPONENT
    is_straight = encoded <= SRGB_LINEAR_BELOW * SRGB_SLOPE
    return dr.select(is_straight, encoded / SRGB_SLOPE, curved)


def _code(value: mi.Float, steps: int) -> mi.UInt32:
    """Nearest code of a value in [0, 1]."""
    return mi.UInt32(dr.round(value * steps))


def _opacity_code(opacity: mi.Float, steps: int) -> mi.UInt32:
    """Nearest code of an opacity, but not 0 unless the opacity is."""
    return dr.maximum(_code(opacity, steps), dr.select(opacity > 0.0, mi.UInt32(1), mi.UInt32(0)))


def _value(word: mi.UInt32, steps: int) -> mi.Float:
    """Value of the code in the lowest bits of a word; `steps` is their mask, too.

    A product, whose value at the highest code is exactly 1 for 255 and 1023, because a quotient
    need not be exact on every back end.
    """
    return mi.Float(word & steps) * (1.0 / steps)


def _opacity_place(
    slot: mi.UInt32 | int, direction_count: int
) -> tuple[mi.UInt32 | int, mi.UInt32 | int]:
    """Slab and first bit of a slot's opacity in `PackedCode`."""
    if direction_count > OPACITIES_PER_WORD:
        return (slot & 1) + direction_count, (slot >> 1) * 10
    return direction_count, slot * 10


def _opacity_error(opacity: np.ndarray, steps: int) -> np.ndarray:
    return np.where((opacity > 0.0) & (opacity < 0.5 / steps), 1.0 / steps, 0.5 / steps)


def _srgb_error(linear: np.ndarray, steps: int) -> np.ndarray:
    """Half a step times the largest slope of the curve within it; the curve is convex."""
    straight = SRGB_SLOPE * linear
    curved = (1.0 + SRGB_OFFSET) * linear ** (1.0 / SRGB_EXPONENT) - SRGB_OFFSET
    half_step = 0.5 / steps
    highest = np.minimum(np.where(linear <= SRGB_LINEAR_BELOW, straight, curved) + half_step, 1.0)
    base = (highest + SRGB_OFFSET) / (1.0 + SRGB_OFFSET)
    slope = SRGB_EXPONENT / (1.0 + SRGB_OFFSET) * base ** (SRGB_EXPONENT - 1.0)
    return half_step * np.where(highest <= SRGB_LINEAR_BELOW * SRGB_SLOPE, 1.0 / SRGB_SLOPE, slope)
