"""Downsampling on the way to storage: each level's words are made of the finer level's.

The words of "float32" hold what the merging of levels reads, so that merged levels need no arrays
of their own: a launch a level reads what the level has of its own and the finer level's words, and
writes its words. Values are those of `downsample` and `pack_volume` bit for bit.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import level_table
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
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.number_rows import IntegerRow
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.downsampling.config import DownsamplingConfig
from vctgi.stages.downsampling.levels import downsample
from vctgi.stages.downsampling.merging import children, merge_emittance, merge_opacity


def downsample_volume(
    opacity: OpacityClipmap,
    emittance: EmittanceClipmap | None,
    config: DownsamplingConfig,
    storage: StorageConfig,
    directions: StoredDirections | None = None,
    *,
    keeps_empty: bool = False,
) -> VoxelVolume:
    """Return what cones read of voxels that are filled at each clip level's own resolution.

    Parameters
    ----------
    opacity, emittance
        As for `downsample`; without emittance all voxels are dark.
    config
        Rule of the mips.
    storage, directions, keeps_empty
        As for `pack_volume`.

    Raises
    ------
    ValueError
        As `pack_volume` does.
    """
    has_derivatives = dr.grad_enabled(
        opacity.levels, None if emittance is None else emittance.levels
    )
    is_direct = storage.format == "float32" and not config.is_isotropic and not has_derivatives
    if is_direct and (directions is not None or storage.direction_count == DIRECTION_COUNT):
        return _Words(opacity, emittance, directions or SIX, keeps_empty=keeps_empty).fill(config)
    merged, lit = downsample(opacity, emittance, config)
    if lit is None:
        dark = [dr.zeros(mi.Color3f, dr.width(level)) for level in merged.levels]
        lit = EmittanceClipmap(merged.layout, dark, [0.0] * merged.layout.clip_level_count)
    return pack_volume(merged, lit, storage, directions, keeps_empty=keeps_empty)


class _Words:
    """Words of all levels, filled one level after the other."""

    def __init__(
        self,
        opacity: OpacityClipmap,
        emittance: EmittanceClipmap | None,
        directions: StoredDirections,
        *,
        keeps_empty: bool,
    ) -> None:
        self.opacity, self.emittance, self.directions = opacity, emittance, directions
        self.layout = opacity.layout
        self.is_empty = _is_empty_merged(opacity, keeps_empty=keeps_empty)
        offsets = stored_offsets(self.layout, self.is_empty)
        # Of texels; a level's slots stand one after the other.
        self.starts = [directions.count * offset for offset in offsets]
        self.table = level_table(self.layout, self.is_empty, offsets[:-1])
        make = dr.zeros if any(self.is_empty) else dr.empty
        self.words = make(mi.Float, TEXEL_CHANNELS * self.starts[-1])

    def fill(self, config: DownsamplingConfig) -> VoxelVolume:
        """Fill all levels, the finest first."""
        for level, empty in zip(self.layout.levels, self.is_empty, strict=True):
            if not empty:
                self._fill_level(level, config)
        code = FloatCode(is_half=False)
        offsets = self.table.voxel_offsets
        texels = GatheredTexels(code, self.words, offsets, self.directions, None)
        return VoxelVolume(self.layout, self.table, texels)

    def _fill_level(self, level: LevelLayout, config: DownsamplingConfig) -> None:
        """Write the words of a level, whose finer one is written."""
        lane = dr.arange(mi.UInt32, self.directions.count * level.voxel_count)
        slot, texel = lane // level.voxel_count, lane % level.voxel_count
        direction = slot
        sources = self.directions.sources
        is_all = sources == list(range(DIRECTION_COUNT))
        if not is_all:
            direction = dr.gather(mi.UInt32, mi.UInt32(sources), slot)
        source = None if is_all else direction * level.voxel_count + texel
        row = self._row(level)
        value = self._own(level, source)
        if level.level > 0:
            finer = self.layout.levels[level.level - 1]
            parent = _voxel(texel, level.resolution, row)
            is_covered = _is_inside(parent, finer.resolution, row)
            if not self.is_empty[finer.level]:
                found = self._merged((parent, slot, direction), finer, row, is_covered, config)
                value = dr.select(is_covered, found, value)
            else:
                value = dr.select(is_covered, mi.Vector4f(0.0), value)
        dr.scatter(self.words, value, lane + mi.UInt32(row[OWN_START]))
        dr.eval(self.words)

    def _row(self, level: LevelLayout) -> IntegerRow:
        """Return where a level and the finer one stand and are stored, which no kernel holds."""
        finer = self.layout.levels[max(level.level - 1, 0)]
        starts = (self.starts[level.level], self.starts[finer.level])
        return IntegerRow([*level.origin, *finer.origin, *starts])

    def _own(self, level: LevelLayout, source: mi.UInt32 | None) -> mi.Vector4f:
        """Return the texels that were voxelized and lit at a level's own resolution."""
        alpha = self.opacity.levels[level.level]
        color = None if self.emittance is None else self.emittance.levels[level.level]
        if source is not None:
            alpha = dr.gather(mi.Float, alpha, source)
            color = None if color is None else dr.gather(mi.Color3f, color, source)
        if color is None:
            color = mi.Color3f(0.0)
        return mi.Vector4f(color.x, color.y, color.z, as_component(alpha))

    def _merged(
        self,
        place: tuple[mi.Vector3i, mi.UInt32, mi.UInt32],
        finer: LevelLayout,
        row: IntegerRow,
        active: mi.Bool,
        config: DownsamplingConfig,
    ) -> mi.Vector4f:
        """Return texels that are made of eight finer ones.

        Parameters
        ----------
        place
            Voxels, their stored slots and the directions of those.
        finer, row
            The finer level, and where it is stored.
        active
            Lanes whose voxels it covers.
        config
            Rule of the mips.
        """
        parent, slot, direction = place
        base = slot * finer.voxel_count + mi.UInt32(row[FINER_START])
        columns = [
            (
                dr.gather(mi.Vector4f, self.words, base + front, active),
                dr.gather(mi.Vector4f, self.words, base + back, active),
            )
            for front, back in children(parent, direction, finer.resolution, config.mips)
        ]
        alpha, shares = merge_opacity(
            [(mi.Float(front.w), mi.Float(back.w)) for front, back in columns], config.mips
        )
        if self.emittance is None:
            return mi.Vector4f(0.0, 0.0, 0.0, as_component(alpha))
        color = merge_emittance([(_color(front), _color(back)) for front, back in columns], shares)
        return mi.Vector4f(color.x, color.y, color.z, as_component(alpha))


FINER_ORIGIN, OWN_START, FINER_START = 3, 6, 7
"""Places in a level's row, behind the lowest voxel of its window."""


def _color(texel: mi.Vector4f) -> mi.Color3f:
    return mi.Color3f(texel.x, texel.y, texel.z)


def _voxel(texel: mi.UInt32, resolution: int, row: IntegerRow) -> mi.Vector3i:
    """Return the voxel that is stored at a texel, as `voxel_from_texel`."""
    stored = (texel % resolution, (texel // resolution) % resolution, texel // resolution**2)
    return mi.Vector3i(
        [row[axis] + ((mi.Int32(stored[axis]) - row[axis]) & (resolution - 1)) for axis in range(3)]
    )


def _is_inside(parent: mi.Vector3i, resolution: int, row: IntegerRow) -> mi.Bool:
    """Whether a voxel's children lie in the finer window; the first decides for all eight."""
    inside = mi.Bool(True)
    for axis in range(3):
        inside &= mi.UInt32(2 * parent[axis] - row[FINER_ORIGIN + axis]) < resolution
    return inside


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
