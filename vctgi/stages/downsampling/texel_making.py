"""Texels of all levels, each level's made of the finer one's, from arrays alone.

What finer levels give to a level is made first, level after level, and kept apart: an array that is
read and written by one kernel is copied before. Everything that a frame may change is an input, so
that what is done here can be recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.stored_directions import StoredDirections
from vctgi.clipmap.texel_target import TexelTarget, WordTarget, stored_edges
from vctgi.clipmap.texture_target import TextureTarget, texture_scale
from vctgi.maths.constant_tables import number_table
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.number_rows import entry
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.downsampling.merging import children, merge_emittance, merge_opacity

if TYPE_CHECKING:
    from typing import Any

    from vctgi.stages.downsampling.config import MipRule

ROW, COVERED = 6, 3
"""Numbers of a level in what `TexelMaker.make` is given, and where those of its covered voxels
begin."""


class SlotEmittance(Protocol):
    """Emittance at each clip level's own resolution, as arrays."""

    def read(self, level: int, index: mi.UInt32, active: mi.Bool) -> mi.Color3f:
        """Return emittance of slots of a clip level."""


@dataclass
class MadeTexels:
    """What was made.

    Attributes
    ----------
    words
        All texels, where they are words; else None, and the texture holds them.
    scale
        Emittance that the texture stores as 1, W m^-2 sr^-1; None of words.
    """

    words: mi.Float | None
    scale: mi.Float | None


@dataclass(frozen=True)
class TexelMaker:
    """How texels are made: all that kernels hold, which tells recordings apart.

    Attributes
    ----------
    resolutions
        Voxels along an edge of each level, finest first.
    clip_level_count
        How many of them are clip levels; the others are mips.
    is_empty
        Which of them hold nothing.
    directions
        Which are stored, and where.
    mips
        How voxels are merged.
    is_texture
        Whether they are stored in a texture, or as words of single precision.
    """

    resolutions: tuple[int, ...]
    clip_level_count: int
    is_empty: tuple[bool, ...]
    directions: StoredDirections
    mips: MipRule
    is_texture: bool

    @property
    def edges(self) -> list[int]:
        """Voxels along an edge of what is stored of each level."""
        return stored_edges(self.resolutions, self.is_empty)

    def make(
        self, alphas: list[mi.Float], emittance: SlotEmittance | None, rows: mi.Int32, texture: Any
    ) -> MadeTexels:
        """Make all texels.

        Parameters
        ----------
        alphas
            Opacity at each clip level's own resolution.
        emittance
            Emittance of the same; None: all voxels are dark.
        rows
            For each level the lowest voxel of its window, and the lowest of it that the finer
            window covers.
        texture
            What `empty_texture` returned for the edges; None where texels are words.
        """
        making = _Making(self, alphas, emittance, rows)
        if not self.is_texture:
            words = WordTarget(self.edges, self.directions)
            making.fill(words)
            return MadeTexels(words.finish(), None)
        scale = texture_scale(making.peak(), merge_count=len(self.resolutions) - 1)
        dr.eval(scale)
        target = TextureTarget(texture, self.edges, self.directions, scale)
        making.fill(target)
        for level, empty in enumerate(self.is_empty):
            if empty:
                target.write(level, mi.Vector4f(0.0))
        dr.eval()
        return MadeTexels(None, scale)


@dataclass
class _Made:
    """Texels [slot, z, y, x] of a level that are made of the finer level's, where that covers it.

    Attributes
    ----------
    resolution
        Voxels along an edge of what is covered; they stand at their place modulo this.
    lowest
        Lowest voxel that is covered.
    texels
        Emittance and opacity, four numbers each; None where all of them are 0.
    """

    resolution: int
    lowest: Sequence[mi.Int32]
    texels: mi.Float | None = None

    def find(self, voxel: mi.Vector3i) -> tuple[mi.Bool, mi.UInt32]:
        """Return whether voxels of the level are covered, and their places in a slot."""
        covered = mi.Bool(True)
        for axis in range(3):
            covered &= mi.UInt32(voxel[axis] - self.lowest[axis]) < self.resolution
        return covered, texel_from_voxel(voxel, self.resolution)

    def read(self, slot: mi.UInt32, place: mi.UInt32, active: mi.Bool) -> mi.Vector4f:
        """Return texels of stored slots at places."""
        if self.texels is None:
            return mi.Vector4f(0.0)
        return dr.gather(mi.Vector4f, self.texels, slot * self.resolution**3 + place, active)


@dataclass
class _Making:
    """What texels are made of; the attributes are arguments of `TexelMaker.make`."""

    maker: TexelMaker
    alphas: list[mi.Float]
    emittance: SlotEmittance | None
    rows: mi.Int32

    def fill(self, target: TexelTarget) -> None:
        """Write the texels of all levels that hold something."""
        maker = self.maker
        made: list[_Made | None] = [None]
        for level in range(1, len(maker.resolutions)):
            made.append(self._make(level, made[-1], target))
        last = maker.clip_level_count if target.is_in_order else len(maker.resolutions)
        for level in range(last):
            if not maker.is_empty[level]:
                self._write(level, made[level], target)

    def peak(self) -> mi.Float:
        """Return the largest emittance of any slot of a clip level, W m^-2 sr^-1."""
        largest = mi.Float(0.0)
        if self.emittance is None:
            return largest
        # All clip levels have as many slots.
        slot = dr.arange(mi.UInt32, dr.width(self.alphas[0]))
        for level in range(self.maker.clip_level_count):
            color = self.emittance.read(level, slot, mi.Bool(True))
            largest = dr.maximum(largest, dr.max(color))
        return mi.Float(dr.max(largest))

    def _row(self, level: int, first: int) -> list[mi.Int32]:
        """Return three numbers of a level."""
        return [entry(self.rows, ROW * level + first + axis) for axis in range(3)]

    def _make(self, level: int, below: _Made | None, target: TexelTarget) -> _Made:
        """Make what the finer level covers of a level, which of a mip is all of it."""
        maker, finer = self.maker, level - 1
        made = _Made(maker.resolutions[finer] // 2, self._row(level, COVERED))
        if maker.is_empty[finer]:
            return made
        lane = dr.arange(mi.UInt32, maker.directions.count * made.resolution**3)
        slot, place = lane // made.resolution**3, lane % made.resolution**3
        parent = _voxel(place, made.resolution, made.lowest)
        direction = self._direction(slot)
        slots = (slot, direction)
        columns = [
            (self._texel(finer, below, front, slots), self._texel(finer, below, back, slots))
            for front, back in children(parent, direction, maker.mips)
        ]
        alpha, shares = merge_opacity(
            [(mi.Float(front.w), mi.Float(back.w)) for front, back in columns], maker.mips
        )
        texel = mi.Vector4f(0.0, 0.0, 0.0, as_component(alpha))
        if self.emittance is not None:
            color = merge_emittance(
                [(_color(front), _color(back)) for front, back in columns], shares
            )
            texel = mi.Vector4f(color.x, color.y, color.z, as_component(alpha))
        made.texels = mi.Float(dr.ravel(texel))
        if target.is_in_order and level >= maker.clip_level_count:
            target.write(level, texel)
        dr.eval(made.texels)
        return made

    def _write(self, level: int, made: _Made | None, target: TexelTarget) -> None:
        """Store the texels of a level, without evaluating them."""
        resolution = self.maker.resolutions[level]
        slot, texel = target.lanes(level)
        index = self._direction(slot) * resolution**3 + texel
        if made is None:
            value = self._own(level, index, mi.Bool(True))
        else:
            voxel = _voxel(texel, resolution, self._row(level, 0))
            is_covered, place = made.find(voxel)
            value = made.read(slot, place, is_covered)
            if level < self.maker.clip_level_count:
                value = dr.select(is_covered, value, self._own(level, index, ~is_covered))
        target.write(level, value)

    def _texel(
        self,
        level: int,
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
        if level >= self.maker.clip_level_count:
            assert made is not None, "a mip is made of a finer level"
            _, place = made.find(voxel)
            return made.read(slot, place, mi.Bool(True))
        resolution = self.maker.resolutions[level]
        index = direction * resolution**3 + texel_from_voxel(voxel, resolution)
        if made is None:
            return self._own(level, index, mi.Bool(True))
        is_covered, place = made.find(voxel)
        own = self._own(level, index, ~is_covered)
        return dr.select(is_covered, made.read(slot, place, is_covered), own)

    def _own(self, level: int, index: mi.UInt32, active: mi.Bool) -> mi.Vector4f:
        """Return texels that were voxelized and lit at a level's own resolution."""
        alpha = dr.gather(mi.Float, self.alphas[level], index, active)
        color = mi.Color3f(0.0)
        if self.emittance is not None:
            color = self.emittance.read(level, index, active)
        return mi.Vector4f(color.x, color.y, color.z, as_component(alpha))

    def _direction(self, slot: mi.UInt32) -> mi.UInt32:
        """Return the direction that a stored slot holds."""
        sources = self.maker.directions.sources
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
