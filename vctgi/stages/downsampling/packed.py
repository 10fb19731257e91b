"""Downsampling on the way to storage: each level's texels are made of the finer level's.

Merged levels need no arrays of their own but for what a finer level covers of a coarser one. The
words of "float32" are those of `downsample` and `pack_volume` bit for bit; the halves of
"texture16" are, but for those that its scale makes the smallest ones there are.
"""

from __future__ import annotations

from typing import Protocol

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import level_table
from vctgi.clipmap.formats import FloatCode
from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.storage import (
    EmittanceClipmap,
    OpacityClipmap,
    StorageConfig,
    VoxelVolume,
    empty_levels,
    pack_volume,
    storage_in_use,
    stored_offsets,
)
from vctgi.clipmap.stored_directions import StoredDirections, directions_of
from vctgi.clipmap.texture_target import empty_texture, texture_texels
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.recording import Recorder, run_recorded
from vctgi.stages.downsampling.config import DownsamplingConfig
from vctgi.stages.downsampling.levels import downsample
from vctgi.stages.downsampling.texel_making import SlotEmittance, TexelMaker

DIRECT_FORMATS = ("float32", "texture16")
"""Formats that levels are stored in as they are made."""


class Light(Protocol):
    """Emittance at each clip level's own resolution, however it is kept."""

    @property
    def slots(self) -> SlotEmittance:
        """Arrays of the same, and nothing else."""

    def emittance(self) -> EmittanceClipmap:
        """Return the emittance of all slots."""


def downsample_volume(
    opacity: OpacityClipmap,
    light: Light | None,
    config: DownsamplingConfig,
    storage: StorageConfig,
    directions: StoredDirections | None = None,
    *,
    keeps_empty: bool = False,
    has_derivatives: bool = False,
    recorder: Recorder | None = None,
) -> VoxelVolume:
    """Return what cones read of voxels that are filled at each clip level's own resolution.

    Parameters
    ----------
    opacity
        As for `downsample`.
    light
        Emittance at each clip level's own resolution; without it all voxels are dark.
    config
        Rule of the mips.
    storage, directions, keeps_empty
        As for `pack_volume`.
    has_derivatives
        Whether derivatives of what cones read are wanted, though the voxels may have none.
    recorder
        Keeps what is traced; None: nobody does.

    Raises
    ------
    ValueError
        As `pack_volume` does, but that "float32" and "texture16" are not searched for numbers that
        they cannot hold: the stages write none.
    """
    is_live = bool(dr.grad_enabled(opacity.levels, getattr(light, "levels", None)))
    stored = directions or directions_of(storage.direction_count)
    storage = storage_in_use(
        storage, opacity.layout, stored, has_derivatives=has_derivatives or is_live
    )
    is_direct = storage.format in DIRECT_FORMATS and not config.is_isotropic and not is_live
    if is_direct and (directions is not None or storage.direction_count == DIRECTION_COUNT):
        layout = opacity.layout
        maker = TexelMaker(
            resolutions=tuple(level.resolution for level in layout.levels),
            clip_level_count=layout.clip_level_count,
            is_empty=tuple(_is_empty_merged(opacity, keeps_empty=keeps_empty)),
            directions=stored,
            mips=config.mips,
            is_texture=storage.format == "texture16",
        )
        return _pack(opacity, light, maker, recorder)
    emittance = None if light is None else light.emittance()
    merged, lit = downsample(opacity, emittance, config)
    if lit is None:
        dark = [dr.zeros(mi.Color3f, dr.width(level)) for level in merged.levels]
        lit = EmittanceClipmap(merged.layout, dark, [0.0] * merged.layout.clip_level_count)
    return pack_volume(merged, lit, storage, directions, keeps_empty=keeps_empty)


def _pack(
    opacity: OpacityClipmap,
    light: Light | None,
    maker: TexelMaker,
    recorder: Recorder | None,
) -> VoxelVolume:
    """Make the texels of all levels, and return them as they are read."""
    layout, is_empty = opacity.layout, list(maker.is_empty)
    offsets = stored_offsets(layout, is_empty)
    table = level_table(layout, is_empty, offsets[:-1])
    rows: list[int] = []
    for level in layout.levels:
        finer = layout.levels[max(level.level - 1, 0)].origin
        rows += [*level.origin, *(each // 2 for each in finer)]
    edges, directions = maker.edges, maker.directions
    texture = empty_texture(edges, directions.count) if maker.is_texture else None
    slots = None if light is None else light.slots
    inputs = (opacity.levels[: layout.clip_level_count], slots, mi.Int32(rows), texture)
    made = run_recorded(recorder, ("downsampling", maker), maker.make, *inputs)
    if made.scale is not None:
        return VoxelVolume(layout, table, texture_texels(texture, edges, directions, made.scale))
    assert made.words is not None, "texels are words where they are in no texture"
    code = FloatCode(is_half=False)
    texels = GatheredTexels(code, made.words, table.voxel_offsets, directions, None)
    return VoxelVolume(layout, table, texels)


def _is_empty_merged(opacity: OpacityClipmap, *, keeps_empty: bool) -> list[bool]:
    """Return which levels have no opacity, with what they get from finer ones."""
    count = len(opacity.levels)
    if keeps_empty:
        return [False] * count
    # Windows are nested, so each level shows what the finest holds; mostly that is all to be read.
    if not empty_levels([opacity.levels[0]])[0]:
        return [False] * count
    own = empty_levels(opacity.levels)
    return [all(own[: level + 1]) for level in range(count)]
