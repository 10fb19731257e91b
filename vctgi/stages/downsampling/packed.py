"""Downsampling on the way to storage: each level's words are made of the finer level's.

The words of "float32" hold what the merging of levels reads, so that merged levels need no arrays
of their own but for what a finer level covers of a coarser one. Values are those of `downsample`
and `pack_volume` bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import level_table, texel_from_voxel
from vctgi.clipmap.formats import TEXEL_CHANNELS, FloatCode
from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.storage import (
    EmittanceClipmap,
    OpacityClipmap,
    StorageConfig,
    VoxelVolume,
    empty_levels,
    pack_volume,
    stored_offsets,
)
from vctgi.clipmap.stored_directions import SIX, StoredDirections
from vctgi.maths.constant_tables import number_table
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.number_rows import IntegerRow
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.downsampling.config import DownsamplingConfig, MipRule
from vctgi.stages.downsampling.levels import downsample
from vctgi.stages.downsampling.merging import children, merge_emittance, merge_opacity


class Light(Protocol):
    """Emittance at each clip level's own resolution, however it is kept."""

    def read(self, level: int, index: mi.UInt32, active: mi.Bool) -> mi.Color3f:
        """Return emittance of slots of a clip level."""

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

    Raises
    ------
    ValueError
        As `pack_volume` does.
    """
    is_direct = storage.format == "float32" and not config.is_isotropic
    is_direct &= directions is not None or storage.direction_count == DIRECTION_COUNT
    if is_direct and not dr.grad_enabled(opacity.levels, getattr(light, "levels", None)):
        packing = _Packing(opacity, light, directions or SIX, keeps_empty=keeps_empty)
        return packing.fill(config.mips)
    emittance = None if light is None else light.emittance()
    merged, lit = downsample(opacity, emittance, config)
    if lit is None:
        dark = [dr.zeros(mi.Color3f, dr.width(level)) for level in merged.levels]
        lit = EmittanceClipmap(merged.layout, dark, [0.0] * merged.layout.clip_level_count)
    return pack_volume(merged, lit, storage, directions, keeps_empty=keeps_empty)


@dataclass
class _Made:
    """Texels [slot, z, y, x] of a level that are made of the finer level's, where that covers it.

    Attributes
    ----------
    level
        The level.
    resolution
        Voxels along an edge of what is covered; they stand at their place modulo this.
    row
        Lowest voxel of the finer window, and of what it covers here.
    texels
        Emittance and opacity, four numbers each; None where all of them are 0.
    """

    level: LevelLayout
    resolution: int
    row: IntegerRow
    texels: mi.Float | None

    def find(self, voxel: mi.Vector3i) -> tuple[mi.Bool, mi.UInt32]:
        """Return whether voxels of the level are covered, and their places in a slot."""
        covered = mi.Bool(True)
        for axis in range(3):
            covered &= mi.UInt32(voxel[axis] - self.row[COVERED + axis]) < self.resolution
        return covered, texel_from_voxel(voxel, self.resolution)

    def read(self, slot: mi.UInt32, place: mi.UInt32, active: mi.Bool) -> mi.Vector4f:
        """Return texels of stored slots at places."""
        if self.texels is None:
            return mi.Vector4f(0.0)
        return dr.gather(mi.Vector4f, self.texels, slot * self.resolution**3 + place, active)


COVERED = 3
"""Place of the lowest covered voxel in the row of `_Made`."""


class _Packing:
    """Words of all levels.

    What finer levels give to a level is made first, level after level, and kept apart: an array
    that is read and written by one kernel is copied before.
    """

    def __init__(
        self,
        opacity: OpacityClipmap,
        light: Light | None,
        directions: StoredDirections,
        *,
        keeps_empty: bool,
    ) -> None:
        self.opacity, self.light, self.directions = opacity, light, directions
        self.layout = opacity.layout
        self.is_empty = _is_empty_merged(opacity, keeps_empty=keeps_empty)
        offsets = stored_offsets(self.layout, self.is_empty)
        # Of texels; a level's slots stand one after the other.
        self.starts = [directions.count * offset for offset in offsets]
        self.table = level_table(self.layout, self.is_empty, offsets[:-1])
        make = dr.zeros if any(self.is_empty) else dr.empty
        self.words = make(mi.Float, TEXEL_CHANNELS * self.starts[-1])

    def fill(self, mips: MipRule) -> VoxelVolume:
        """Fill all levels."""
        made: list[_Made | None] = [None]
        for level in self.layout.levels[1:]:
            made.append(self._make(level, made[-1], mips))
        for level in self.layout.clip_levels:
            if not self.is_empty[level.level]:
                self._write(level, made[level.level])
        # All clip levels in one launch.
        dr.eval(self.words)
        code, offsets = FloatCode(is_half=False), self.table.voxel_offsets
        texels = GatheredTexels(code, self.words, offsets, self.directions, None)
        return VoxelVolume(self.layout, self.table, texels)

    def _make(self, level: LevelLayout, below: _Made | None, mips: MipRule) -> _Made:
        """Make what the finer level covers of a level, which of a mip is all of it."""
        finer = self.layout.levels[level.level - 1]
        row = IntegerRow([*finer.origin, *(each // 2 for each in finer.origin)])
        made = _Made(level, finer.resolution // 2, row, None)
        if self.is_empty[finer.level]:
            return made
        lane = dr.arange(mi.UInt32, self.directions.count * made.resolution**3)
        slot, place = lane // made.resolution**3, lane % made.resolution**3
        parent = _voxel(place, made.resolution, [row[COVERED + axis] for axis in range(3)])
        direction = self._direction(slot)
        slots = (slot, direction)
        columns = [
            (self._texel(finer, below, front, slots), self._texel(finer, below, back, slots))
            for front, back in children(parent, direction, mips)
        ]
        alpha, shares = merge_opacity(
            [(mi.Float(front.w), mi.Float(back.w)) for front, back in columns], mips
        )
        texel = mi.Vector4f(0.0, 0.0, 0.0, as_component(alpha))
        if self.light is not None:
            color = merge_emittance(
                [(_color(front), _color(back)) for front, back in columns], shares
            )
            texel = mi.Vector4f(color.x, color.y, color.z, as_component(alpha))
        made.texels = mi.Float(dr.ravel(texel))
        if level.level >= self.layout.clip_level_count:
            dr.scatter(self.words, texel, lane + self.starts[level.level])
        dr.eval(made.texels)
        return made

    def _write(self, level: LevelLayout, made: _Made | None) -> None:
        """Write the words of a clip level, without evaluating them."""
        lane = dr.arange(mi.UInt32, self.directions.count * level.voxel_count)
        slot, texel = lane // level.voxel_count, lane % level.voxel_count
        index = self._direction(slot) * level.voxel_count + texel
        if made is None:
            value = self._own(level, index, mi.Bool(True))
        else:
            origin = IntegerRow(level.origin)
            voxel = _voxel(texel, level.resolution, [origin[axis] for axis in range(3)])
            is_covered, place = made.find(voxel)
            value = self._own(level, index, ~is_covered)
            value = dr.select(is_covered, made.read(slot, place, is_covered), value)
        # Without the mode, Dr.Jit launches a level before the next is added.
        start = self.starts[level.level]
        dr.scatter(self.words, value, lane + start, mode=dr.ReduceMode.NoConflicts)

    def _texel(
        self,
        level: LevelLayout,
        made: _Made | None,
        voxel: mi.Vector3i,
        slots: tuple[mi.UInt32, mi.UInt32],
    ) -> mi.Vector4f:
        """Return texels of a level, of its own or made of the finer level's.

        Parameters
        ----------
        level, made
            The level, and what is made of it.
        voxel
            Voxels in its window.
        slots
            Stored slots, and the directions that they hold.
        """
        slot, direction = slots
        if level.level >= self.layout.clip_level_count:
            assert made is not None, "a mip is made of a finer level"
            _, place = made.find(voxel)
            return made.read(slot, place, mi.Bool(True))
        index = direction * level.voxel_count + texel_from_voxel(voxel, level.resolution)
        if made is None:
            return self._own(level, index, mi.Bool(True))
        is_covered, place = made.find(voxel)
        own = self._own(level, index, ~is_covered)
        return dr.select(is_covered, made.read(slot, place, is_covered), own)

    def _own(self, level: LevelLayout, index: mi.UInt32, active: mi.Bool) -> mi.Vector4f:
        """Return texels that were voxelized and lit at a level's own resolution."""
        alpha = dr.gather(mi.Float, self.opacity.levels[level.level], index, active)
        color = mi.Color3f(0.0)
        if self.light is not None:
            color = self.light.read(level.level, index, active)
        return mi.Vector4f(color.x, color.y, color.z, as_component(alpha))

    def _direction(self, slot: mi.UInt32) -> mi.UInt32:
        """Return the direction that a stored slot holds."""
        sources = self.directions.sources
        if sources == list(range(DIRECTION_COUNT)):
            return slot
        return dr.gather(mi.UInt32, number_table(tuple(sources)), slot)


def _color(texel: mi.Vector4f) -> mi.Color3f:
    return mi.Color3f(texel.x, texel.y, texel.z)


def _voxel(texel: mi.UInt32, resolution: int, origin: Sequence[mi.Int32]) -> mi.Vector3i:
    """Return the voxel that is stored at a texel of a window, as `voxel_from_texel`."""
    stored = (texel % resolution, (texel // resolution) % resolution, texel // resolution**2)
    return mi.Vector3i(
        [
            low + ((mi.Int32(place) - low) & (resolution - 1))
            for low, place in zip(origin, stored, strict=True)
        ]
    )


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
