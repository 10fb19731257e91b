"""How voxels are stored to be read, and bringing them into that format.

`pack_volume` brings what the stages work on (`working_voxels.py`) into the format that cones read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.addressing import LevelTable, level_table
from vctgi.clipmap.formats import FloatCode, LevelTexels, TexelCode
from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.integer_formats import ByteCode, PackedCode
from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.clipmap.neighbourhood import VoxelTexels
from vctgi.clipmap.reduction import reduce_directions
from vctgi.clipmap.stored_directions import StoredDirections, directions_of, select_directions
from vctgi.clipmap.texel_choice import TexelChoice
from vctgi.clipmap.texture_target import (
    MAX_TEXTURE_DEPTH,
    build_texture,
    texture_depth,
    texture_scale,
)
from vctgi.clipmap.working_voxels import EmittanceClipmap as EmittanceClipmap
from vctgi.clipmap.working_voxels import OpacityClipmap as OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT

StorageFormat = Literal["auto", "float32", "float16", "rgb10a2", "rgba8", "srgb8", "texture16"]
"""What texels are stored as; "auto" is one of the others."""

CODES: dict[str, TexelCode] = {
    "float32": FloatCode(is_half=False),
    "float16": FloatCode(is_half=True),
    "rgb10a2": PackedCode(),
    "rgba8": ByteCode(is_srgb=False),
    "srgb8": ByteCode(is_srgb=True),
    "texture16": FloatCode(is_half=True),
}
"""What the words of each format mean."""

SCALED_FORMATS = ("rgb10a2", "rgba8", "srgb8")
"""Formats of integers, which need a storage scale."""

SMALLEST_SCALE_EXPONENT = -126
"""Exponent of the smallest scale that is chosen, that of the smallest normal number."""


@dataclass(frozen=True, kw_only=True)
class StorageConfig:
    """How voxels are stored to be read."""

    format: StorageFormat = "float32"
    """float32 and float16: numbers; rgb10a2: the talk's words of ten bits a channel; rgba8 and
    srgb8: bytes, linear or with sRGB-encoded colour; texture16: half precision, interpolated by a
    GPU's texture units, only on CUDA; auto: texture16 on CUDA where nothing has derivatives and the
    voxels fit one texture, float32 elsewhere."""
    direction_count: int = DIRECTION_COUNT
    """6 one-sided directions; 3, one for each axis; or 1, for comparison only."""
    scale: float | None = None
    """Emittance that the formats of integers store as 1, W m^-2 sr^-1, > 0; None: the largest that
    there is, rounded up to a power of two."""

    def __post_init__(self) -> None:
        """Refuse formats that do not exist."""
        formats = get_args(StorageFormat)
        if self.format not in formats:
            raise ValueError(f"StorageConfig.format must be one of {formats}, got {self.format!r}.")
        if self.direction_count not in (6, 3, 1):
            raise ValueError(
                f"StorageConfig.direction_count must be 6, 3 or 1, got {self.direction_count}."
            )
        if self.scale is None:
            return
        if self.format not in SCALED_FORMATS:
            raise ValueError(
                f'StorageConfig.scale is for {SCALED_FORMATS}; leave it None for "{self.format}", '
                "which needs none."
            )
        if not 2.0**SMALLEST_SCALE_EXPONENT <= self.scale <= 2.0**-SMALLEST_SCALE_EXPONENT:
            raise ValueError(
                "StorageConfig.scale must be a normal number in single precision, > 0, "
                f"got {self.scale}."
            )


@dataclass
class VoxelVolume:
    """Opacity and emittance in the format that is read: what cones march through.

    Attributes
    ----------
    layout
        Where the levels lie.
    table
        Where the stored voxels lie, as device arrays: a level without opacity is one empty voxel.
    texels
        The voxels.
    choice
        What chooses the texels that each lane's cone reads; None: all around are interpolated.
    """

    layout: ClipmapLayout
    table: LevelTable
    texels: VoxelTexels
    choice: TexelChoice | None = None

    @property
    def byte_count(self) -> int:
        """Bytes of the voxels."""
        return self.texels.byte_count

    @property
    def has_derivatives(self) -> bool:
        """Whether any of the voxels has."""
        return isinstance(self.texels, GatheredTexels) and bool(dr.grad_enabled(self.texels.words))

    def choosing(self, choice: TexelChoice | None) -> VoxelVolume:
        """Return the same voxels, read by what a choice leaves of the texels around a point."""
        return replace(self, choice=choice)


def storage_in_use(
    config: StorageConfig,
    layout: ClipmapLayout,
    directions: StoredDirections,
    *,
    has_derivatives: bool,
) -> StorageConfig:
    """Return a configuration whose format is not "auto".

    Parameters
    ----------
    config
        What is asked for.
    layout
        The levels.
    directions
        Which are stored.
    has_derivatives
        Whether derivatives of what is read are wanted.

    Raises
    ------
    ValueError
        A texture without a GPU.
    """
    is_gpu = dr.backend_v(mi.Float) == dr.JitBackend.CUDA
    if config.format == "auto":
        edges = [level.resolution for level in layout.levels]
        fits = texture_depth(edges, directions.count) <= MAX_TEXTURE_DEPTH
        is_texture = is_gpu and fits and not has_derivatives
        return replace(config, format="texture16" if is_texture else "float32")
    if config.format == "texture16" and not is_gpu:
        raise ValueError(
            'StorageConfig.format "texture16" needs the texture units of a GPU, and the variant '
            f'is {mi.variant()}: set a CUDA variant, or use the format "float16".'
        )
    return config


def bytes_per_voxel(config: StorageConfig) -> int:
    """Return the bytes that a voxel takes, all directions together; of "auto" those of "float32".

    What a texture repeats at the rims of its slabs, and of levels smaller than itself, comes on
    top; `VoxelVolume.byte_count` counts it.
    """
    code = CODES["float32" if config.format == "auto" else config.format]
    return code.word_bytes * code.slab_count(config.direction_count)


def pack_volume(
    opacity: OpacityClipmap,
    emittance: EmittanceClipmap,
    config: StorageConfig = StorageConfig(),
    directions: StoredDirections | None = None,
    *,
    keeps_empty: bool = False,
) -> VoxelVolume:
    """Bring opacity and emittance of the same layout into the format that is read.

    Parameters
    ----------
    opacity, emittance
        What the voxels hold.
    config
        Format, directions and scale.
    directions
        Which of six directions are worth storing; None: as many as `config` says.
    keeps_empty
        Whether levels without opacity are stored, too.

    Raises
    ------
    ValueError
        The format cannot hold what is there: emittance above the scale or the largest number, or
        where there is no opacity, or numbers that are none; a texture of too many layers; a texture
        without CUDA; values with derivatives, in another format than "float32".
    """
    layout = opacity.layout
    assert layout == emittance.layout, "opacity and emittance must share one layout"
    has_derivatives = bool(dr.grad_enabled(opacity.levels, emittance.levels))
    if config.format not in ("float32", "auto") and has_derivatives:
        raise ValueError(
            f'StorageConfig.format "{config.format}" has no derivatives, and the voxels have: '
            'use "float32", or detach what they follow from.'
        )
    stored = directions or directions_of(config.direction_count)
    # Single precision holds whatever the stages wrote, so it is not searched for what it cannot;
    # nor is what "auto" chooses, which is for what they write.
    is_searched = config.format not in ("float32", "auto")
    config = storage_in_use(config, layout, stored, has_derivatives=has_derivatives)
    is_empty = [empty and not keeps_empty for empty in empty_levels(opacity.levels)]
    scale = _find_scale(opacity, emittance, config) if is_searched else None

    def texels_of(level: LevelLayout) -> LevelTexels:
        color = emittance.levels[level.level]
        texels = LevelTexels(color, opacity.levels[level.level], DIRECTION_COUNT)
        if directions is None:
            texels = reduce_directions(texels, config.direction_count)
        else:
            texels = select_directions(texels, directions)
        if scale is not None:
            texels.emittance = texels.emittance * (1.0 / scale)
        return texels

    offsets = stored_offsets(layout, is_empty)
    table = level_table(layout, is_empty, offsets[:-1])
    levels = list(layout.levels)
    if config.format == "texture16":
        peak = mi.Float(0.0)
        for color in emittance.levels:
            peak = dr.maximum(peak, dr.max(dr.max(color)))
        unit = texture_scale(peak, merge_count=0)
        return VoxelVolume(layout, table, build_texture(levels, is_empty, texels_of, stored, unit))

    code = CODES[config.format]
    slab_count = code.slab_count(stored.count)
    words = code.allocate(slab_count * offsets[-1])
    for level, empty, offset in zip(levels, is_empty, offsets[:-1], strict=True):
        if not empty:
            code.encode(words, slab_count * offset, texels_of(level))
    dr.eval(words)
    device_scale = None if scale is None else dr.opaque(mi.Float, scale)
    texels = GatheredTexels(code, words, table.voxel_offsets, stored, device_scale)
    return VoxelVolume(layout, table, texels)


def _find_scale(
    opacity: OpacityClipmap, emittance: EmittanceClipmap, config: StorageConfig
) -> float | None:
    """Return the scale that emittance is stored at, None for numbers as they are.

    Raises
    ------
    ValueError
        Something has no code.
    """
    fits, peaks = [], []
    for alpha, color in zip(opacity.levels, emittance.levels, strict=True):
        largest = mi.Float(dr.max(color))
        has_surface = (alpha > 0.0) | (largest == 0.0)
        is_number = dr.all((color >= 0.0) & (color < dr.inf))
        fits.append(dr.all((alpha >= 0.0) & (alpha <= 1.0) & has_surface & mi.Bool(is_number)))
        peaks.append(dr.max(largest))
    dr.eval(fits, peaks)
    for level, fit in enumerate(fits):
        if not bool(fit[0]):
            raise ValueError(
                f'StorageConfig.format "{config.format}" cannot hold level {level}: opacity '
                "outside [0, 1], emittance below 0 or not finite, or emittance where opacity is 0. "
                'The format "float32" stores it for inspection.'
            )
    peak = max(float(each[0]) for each in peaks)
    if config.format == "texture16":
        return None
    if config.format not in SCALED_FORMATS:
        limit = CODES[config.format].max_emittance
        if peak > limit:
            raise ValueError(
                f'StorageConfig.format "{config.format}" holds emittance up to {limit:g}, and the '
                f'largest is {peak:g} W m^-2 sr^-1: use "float32", or "rgb10a2", which scales.'
            )
        return None
    if config.scale is None:
        # frexp gives peak = m 2^e with m in [1/2, 1).
        mantissa, exponent = math.frexp(peak)
        exponent -= mantissa == 0.5
        return 2.0 ** max(exponent, SMALLEST_SCALE_EXPONENT) if peak > 0.0 else 1.0
    if peak > config.scale:
        raise ValueError(
            f"StorageConfig.scale is {config.scale:g}, and the largest emittance is {peak:g} "
            "W m^-2 sr^-1: set it at least so large, or None to have it chosen."
        )
    return config.scale


def empty_levels(levels: Sequence[mi.Float]) -> list[bool]:
    """Return which levels of opacities are 0 all over."""
    # Opacities are 0 or more, so the largest tells; all levels answer at once.
    largest = [dr.max(dr.detach(level)) for level in levels]
    dr.eval(largest)
    held = largest[0] if len(largest) == 1 else dr.concat(largest)
    return [not value > 0.0 for value in np.array(held)]


def stored_offsets(layout: ClipmapLayout, is_empty: list[bool]) -> list[int]:
    """Voxels stored before each level, and of all levels; a level without opacity is one voxel."""
    offsets = [0]
    for level, empty in zip(layout.levels, is_empty, strict=True):
        offsets.append(offsets[-1] + (1 if empty else level.voxel_count))
    return offsets
