"""Codes of texels: how emittance and opacity of a voxel become words of memory, and back.

Opacity 0 and 1 are exact in every code. Opacity that is above 0 stays above 0, at the code's
smallest step at least, so that no surface vanishes and no light is left without a surface that it
comes from. Each code states how far a value may move; tests/vctgi/clipmap/test_formats.py holds it
to that. The bounds are those of rounding to the nearest code; single precision adds a few 1e-7 of
the value while coding and decoding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.stub_gaps import as_component

if TYPE_CHECKING:
    from typing import TypeAlias

    from drjit.auto.ad import Array4f16

    Words: TypeAlias = mi.Float | mi.Float16 | mi.UInt32
else:
    # Dr.Jit reads the annotations of records that pass through `mi.render`.
    Words = object

TEXEL_CHANNELS = 4
"""Red, green, blue emittance and opacity, side by side so that one packet load reads them."""

MAX_HALF = 65504.0
"""Largest finite half-precision number."""

MIN_HALF = 2.0**-24
"""Smallest half-precision number above 0, the step of all below 2^-14."""


@dataclass
class LevelTexels:
    """The texels of one level before they are coded.

    Attributes
    ----------
    emittance
        Flat [direction, z, y, x], premultiplied by opacity; W m^-2 sr^-1, or in units of the
        storage scale where a code is asked for that.
    opacity
        Flat [direction, z, y, x], [0, 1].
    direction_count
        Directions: 6, 3 or 1.
    """

    emittance: mi.Color3f
    opacity: mi.Float
    direction_count: int


@dataclass
class VoxelAddress:
    """Where the words of one voxel lie.

    A level's words are stored in slabs, one word of every voxel after the other.

    Attributes
    ----------
    start
        First word of the level.
    stride
        Words of a slab: the level's voxels.
    place
        The voxel's word within each slab.
    """

    start: mi.UInt32
    stride: mi.UInt32
    place: mi.UInt32

    def word(self, slab: mi.UInt32 | int) -> mi.UInt32:
        """Index of the voxel's word in a slab."""
        # In this order the first sum is the same for all voxels of a layer, and computed once.
        return (self.start + slab * self.stride) + self.place


class TexelCode(Protocol):
    """How texels become words.

    Emittance is in units of the storage scale where the code is for integers.
    """

    @property
    def word_bytes(self) -> int:
        """Bytes of what one index addresses."""

    @property
    def max_emittance(self) -> float:
        """Largest emittance that has a code, in units of the storage scale."""

    def slab_count(self, direction_count: int) -> int:
        """Words of a voxel."""

    def allocate(self, count: int) -> Words:
        """Return `count` words of empty voxels."""

    def encode(self, words: Words, first: int, texels: LevelTexels) -> None:
        """Write the texels of a level, [direction, z, y, x], from word `first` on."""

    def fetch(
        self,
        words: Words,
        voxel: VoxelAddress,
        slot: mi.UInt32 | int,
        direction_count: int,
        active: mi.Bool | bool,
    ) -> mi.Vector4f:
        """Read a texel: emittance and opacity of a slot of a voxel."""

    def emittance_error(self, emittance: np.ndarray) -> np.ndarray:
        """Bound on how far an emittance moves, both in units of the storage scale."""

    def opacity_error(self, opacity: np.ndarray) -> np.ndarray:
        """Bound on how far an opacity moves."""


@dataclass(frozen=True)
class FloatCode:
    """Four floating-point numbers a texel, of single or half precision.

    Single precision changes nothing. Half precision rounds to 11 significant bits, so a value moves
    by 2^-11 of itself at most, and below 2^-14, where the step is 2^-24, by 2^-25; opacity below
    2^-25 becomes 2^-24. Emittance above 65504 has no code.
    """

    is_half: bool

    @property
    def word_bytes(self) -> int:
        """Bytes of a texel."""
        return TEXEL_CHANNELS * (2 if self.is_half else 4)

    @property
    def max_emittance(self) -> float:
        """Largest finite number."""
        return MAX_HALF if self.is_half else float(np.finfo(np.float32).max)

    def slab_count(self, direction_count: int) -> int:
        """One texel for each direction."""
        return direction_count

    def allocate(self, count: int) -> mi.Float | mi.Float16:
        """Return `count` texels of zeros."""
        if self.is_half:
            return dr.zeros(mi.Float16, TEXEL_CHANNELS * count)
        return dr.zeros(mi.Float, TEXEL_CHANNELS * count)

    def encode(self, words: Words, first: int, texels: LevelTexels) -> None:
        """Write texels as they are, or rounded to half precision."""
        index = dr.arange(mi.UInt32, dr.width(texels.opacity)) + first
        if self.is_half:
            dr.scatter(words, half_texels(texels.emittance, texels.opacity), index)
        else:
            color, opacity = texels.emittance, as_component(texels.opacity)
            dr.scatter(words, mi.Vector4f(color.x, color.y, color.z, opacity), index)

    def fetch(
        self,
        words: Words,
        voxel: VoxelAddress,
        slot: mi.UInt32 | int,
        direction_count: int,
        active: mi.Bool | bool,
    ) -> mi.Vector4f:
        """Read a texel by one packet load."""
        index = voxel.word(slot)
        if self.is_half:
            # Mitsuba's stubs call its half-precision arrays plain objects.
            return mi.Vector4f(dr.gather(mi.Array4f16, words, index, active))  # type: ignore[arg-type]
        return dr.gather(mi.Vector4f, words, index, active)

    def emittance_error(self, emittance: np.ndarray) -> np.ndarray:
        """Half a step of half precision; nothing in single precision."""
        if not self.is_half:
            return np.zeros_like(emittance)
        return np.maximum(2.0**-11 * emittance, 0.5 * MIN_HALF)

    def opacity_error(self, opacity: np.ndarray) -> np.ndarray:
        """Half a step, or a whole one where it would have become 0."""
        if not self.is_half:
            return np.zeros_like(opacity)
        return np.maximum(
            2.0**-11 * opacity, np.where(opacity < 0.5 * MIN_HALF, MIN_HALF, 0.5 * MIN_HALF)
        )


def half_texels(emittance: mi.Color3f, opacity: mi.Float) -> Array4f16:
    """Round texels to half precision, opacity above 0 to no less than the smallest number."""
    opacity = dr.select(opacity > 0.0, dr.maximum(opacity, MIN_HALF), opacity)
    texel = mi.Vector4f(emittance.x, emittance.y, emittance.z, as_component(opacity))
    return mi.Array4f16(texel)  # type: ignore[operator, no-any-return]
