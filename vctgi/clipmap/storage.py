"""What the clipmap holds: opacity and emittance of every voxel along six directions.

Values are stored [level, direction, z, y, x] with each level's texels at their toroidal address.
Emittance is premultiplied by opacity (radiance x opacity), so that it filters like colour with
alpha.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import LevelTable, level_table
from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.slots import DEFAULT_RULE, SlotRule
from vctgi.maths.directions import DIRECTION_COUNT

TEXEL_CHANNELS = 4
"""Red, green, blue emittance and opacity, side by side so that one packet load reads them."""


@dataclass
class OpacityClipmap:
    """Opacity of every voxel.

    Attributes
    ----------
    layout
        Where the levels lie.
    levels
        For each level the flat opacities [direction, z, y, x], in [0, 1]: the share of light that
        one voxel of the level stops along that direction of travel.
    rule
        How thick the surfaces were made, which their light has to follow.
    """

    layout: ClipmapLayout
    levels: list[mi.Float]
    rule: SlotRule = DEFAULT_RULE


@dataclass
class EmittanceClipmap:
    """Emittance of every voxel.

    Attributes
    ----------
    layout
        Where the levels lie.
    levels
        For each level the flat emittances [direction, z, y, x] in W m^-2 sr^-1, premultiplied by
        opacity: what a ray travelling along the direction meets from its front.
    lost_flux_share
        Share of the reflected flux that fell where the clipmap has no opacity, per clip level.
    """

    layout: ClipmapLayout
    levels: list[mi.Color3f]
    lost_flux_share: list[float]


@dataclass(frozen=True, kw_only=True)
class StorageConfig:
    """How voxels are stored for reading."""

    format: Literal["float32"] = "float32"
    """What a channel of a voxel is stored as."""

    def __post_init__(self) -> None:
        """Refuse formats that do not exist."""
        if self.format not in get_args(Literal["float32"]):
            raise ValueError(f'StorageConfig.format must be "float32", got {self.format!r}.')


@dataclass
class VoxelVolume:
    """Opacity and emittance interleaved for reading: what cones march through.

    Attributes
    ----------
    layout
        Where the levels lie.
    table
        The same as device arrays.
    texels
        Flat [level, direction, z, y, x, 4]: premultiplied emittance RGB (W m^-2 sr^-1), opacity.
    """

    layout: ClipmapLayout
    table: LevelTable
    texels: mi.Float


def pack_volume(
    opacity: OpacityClipmap, emittance: EmittanceClipmap, config: StorageConfig = StorageConfig()
) -> VoxelVolume:
    """Put opacity and emittance of the same layout side by side for reading."""
    layout = opacity.layout
    assert layout == emittance.layout, "opacity and emittance must share one layout"
    texels = dr.empty(mi.Float, TEXEL_CHANNELS * DIRECTION_COUNT * layout.voxel_count)
    for level, offset in zip(layout.levels, layout.voxel_offsets, strict=True):
        count = DIRECTION_COUNT * level.voxel_count
        index = dr.arange(mi.UInt32, count) + DIRECTION_COUNT * offset
        color = emittance.levels[level.level]
        texel = mi.Vector4f(color.x, color.y, color.z, opacity.levels[level.level])
        dr.scatter(texels, texel, index)
    dr.eval(texels)
    return VoxelVolume(layout, level_table(layout), texels)
