"""Where texels are written to be read, level by level: arrays of words, or a texture.

A target says which texel each lane is to make, so that every way of storing is written by lanes
side by side; `texture_target.py` is the texture's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import TEXEL_CHANNELS
from vctgi.clipmap.stored_directions import StoredDirections


def stored_edges(resolutions: Sequence[int], is_empty: Sequence[bool]) -> list[int]:
    """Return the voxels along an edge of what is stored of each level: one of an empty level."""
    pairs = zip(resolutions, is_empty, strict=True)
    return [1 if empty else resolution for resolution, empty in pairs]


class TexelTarget(Protocol):
    """Where texels are stored, level after level.

    Attributes
    ----------
    is_in_order
        Whether the lanes of a level are its slots' texels one after the other.
    """

    is_in_order: bool

    def lanes(self, level: int) -> tuple[mi.UInt32, mi.UInt32]:
        """Return the stored slot and the texel [z, y, x] of a level that each lane writes."""

    def write(self, level: int, texel: mi.Vector4f) -> None:
        """Write emittance and opacity of these lanes, without evaluating them."""


class WordTarget:
    """Words of single precision: a level's slots stand one after the other.

    Parameters
    ----------
    edges
        Voxels along an edge of what is stored of each level.
    directions
        Which are stored, and where.
    """

    is_in_order = True

    def __init__(self, edges: Sequence[int], directions: StoredDirections) -> None:
        self._counts = [edge**3 for edge in edges]
        self._slot_count = directions.count
        # A level that holds nothing is one voxel, which nobody writes.
        make = dr.zeros if 1 in edges else dr.empty
        self._words = make(mi.Float, TEXEL_CHANNELS * self._slot_count * sum(self._counts))

    def lanes(self, level: int) -> tuple[mi.UInt32, mi.UInt32]:
        """Return the stored slot and the texel [z, y, x] of a level that each lane writes."""
        count = self._counts[level]
        lane = dr.arange(mi.UInt32, self._slot_count * count)
        return lane // count, lane % count

    def write(self, level: int, texel: mi.Vector4f) -> None:
        """Write emittance and opacity of these lanes, without evaluating them."""
        start = self._slot_count * sum(self._counts[:level])
        lane = dr.arange(mi.UInt32, self._slot_count * self._counts[level])
        # Without the mode, Dr.Jit launches a level before the next is added.
        dr.scatter(self._words, texel, lane + start, mode=dr.ReduceMode.NoConflicts)

    def finish(self) -> mi.Float:
        """Return what was written."""
        dr.eval(self._words)
        return self._words
