"""Texels in arrays, fetched one by one: every storage format but the texture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import TexelCode, VoxelAddress, Words
from vctgi.clipmap.neighbourhood import Layer, Neighbourhood
from vctgi.clipmap.stored_directions import StoredDirections
from vctgi.maths.directions import other_axes


@dataclass
class GatheredTexels:
    """Coded texels, level after level; within a level [slab, z, y, x].

    Attributes
    ----------
    code
        What the words mean.
    words
        All of them.
    voxel_offsets
        [level]: voxels that are stored before the level's.
    directions
        Which are stored, and where.
    scale
        One number: emittance of code value 1, W m^-2 sr^-1, or None where codes are the emittance.
    """

    code: TexelCode
    words: Words
    voxel_offsets: mi.UInt32
    directions: StoredDirections
    scale: mi.Float | None

    @property
    def byte_count(self) -> int:
        """Bytes of all words."""
        return dr.itemsize_v(self.words) * dr.width(self.words)

    def has_axis(self, axis: int) -> bool:
        """Whether there is anything to read for travel along an axis."""
        return self.directions.has_axis(axis)

    def taps(
        self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool = True
    ) -> Iterator[tuple[mi.Float, mi.Float, mi.Vector4f]]:
        """Fetch the four texels of a layer around the point."""
        u, v = other_axes(layer.axis)
        for step_u in range(2):
            for step_v in range(2):
                texel = self._fetch(around, layer, {u: step_u, v: step_v}, active)
                yield around.weights[u][step_u], around.weights[v][step_v], texel

    def texel(self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool) -> mi.Vector4f:
        """Fetch one texel of a layer."""
        u, v = other_axes(layer.axis)
        return self._fetch(around, layer, {u: 0, v: 0}, active)

    def _fetch(
        self,
        around: Neighbourhood,
        layer: Layer,
        steps: dict[int, int],
        active: mi.Bool | bool,
    ) -> mi.Vector4f:
        """Fetch the texel of a layer so many steps above the lowest across it."""
        bits = around.resolution_bits
        offset = dr.gather(mi.UInt32, self.voxel_offsets, around.level)
        count = self.directions.count
        slot, is_stored = self.directions.find(layer)
        parts = {layer.axis: around.stored(layer.voxel) << (layer.axis * bits)}
        for axis, step in steps.items():
            parts[axis] = around.stored(mi.Float(around.lowest[axis] + step)) << (axis * bits)
        # In the same order for every axis, so that equal sums are computed once.
        place = parts[0] + parts[1] + parts[2]
        voxel = VoxelAddress(
            offset * self.code.slab_count(count), mi.UInt32(1) << (3 * bits), place
        )
        return self.code.fetch(self.words, voxel, slot, count, active & is_stored)
