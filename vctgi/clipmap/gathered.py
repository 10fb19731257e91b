"""Texels in arrays, fetched one by one: every storage format but the texture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import TexelCode, VoxelAddress, Words
from vctgi.clipmap.neighbourhood import Layer, Neighbourhood
from vctgi.maths.directions import DIRECTION_COUNT, other_axes
from vctgi.maths.stub_gaps import as_component


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
    direction_count
        Stored directions: 6, 3 or 1.
    scale
        One number: emittance of code value 1, W m^-2 sr^-1, or None where codes are the emittance.
    """

    code: TexelCode
    words: Words
    voxel_offsets: mi.UInt32
    direction_count: int
    scale: mi.Float | None

    @property
    def byte_count(self) -> int:
        """Bytes of all words."""
        return dr.itemsize_v(self.words) * dr.width(self.words)

    def taps(
        self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool = True
    ) -> Iterator[tuple[mi.Float, mi.Float, mi.Vector4f]]:
        """Fetch the four texels of a layer around the point."""
        u, v = other_axes(layer.axis)
        bits = around.resolution_bits
        offset = dr.gather(mi.UInt32, self.voxel_offsets, around.level)
        start = offset * self.code.slab_count(self.direction_count)
        slot = stored_slot(layer, self.direction_count)
        stride = mi.UInt32(1) << (3 * bits)
        parts = {layer.axis: around.stored(layer.voxel) << (layer.axis * bits)}
        for step_u in range(2):
            parts[u] = around.stored(mi.Int32(around.lowest[u] + step_u)) << (u * bits)
            for step_v in range(2):
                parts[v] = around.stored(mi.Int32(around.lowest[v] + step_v)) << (v * bits)
                # In the same order for every axis, so that equal sums are computed once.
                place = parts[0] + parts[1] + parts[2]
                voxel = VoxelAddress(start, stride, place)
                texel = self.code.fetch(self.words, voxel, slot, self.direction_count, active)
                if self.scale is not None:
                    color_scale = as_component(self.scale)
                    texel *= mi.Vector4f(color_scale, color_scale, color_scale, 1.0)
                yield around.weights[u][step_u], around.weights[v][step_v], texel


def stored_slot(layer: Layer, direction_count: int) -> mi.UInt32 | int:
    """Return which of the stored directions holds a layer's."""
    if direction_count == DIRECTION_COUNT:
        return 2 * layer.axis + layer.side
    return layer.axis if direction_count == 3 else 0
