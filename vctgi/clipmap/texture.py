"""Texels in a texture that the hardware interpolates: one fetch for a layer instead of four.

All levels and directions lie in one texture, stacked along its third axis. The slab of one
direction of one level is the level's texels with one more layer at both ends, a copy of the one at
the other end, and repeated along the first two axes where the level is smaller than the texture.
So the two texels next to any place of a toroidal window are neighbours in the texture, too.

Voxels outside the window must count as empty, which no wrap mode does at a place that moves. The
place is therefore clamped to the centres of the outermost voxels of the window, where a fetch gives
the outermost voxel alone, and the result is weighed by what is left of that voxel's weight: at a
distance s in [0, 1] outside the outermost centre, linear interpolation gives that voxel 1 - s and
the empty one s, of nothing. Along each axis that is the same sum, so their product is, too.

Half precision has as many numbers below 1 as above it, and ends at 65504. Emittance is therefore
stored in units of a scale, a power of two that follows the brightest voxel, which moves where those
numbers lie and rounds nothing by itself.

The texture unit rounds its weights to 2^-8, so by 2^-9 at most, and places are normalised to [0, 1]
and back in single precision: five roundings of 2^-25 of the texture's size. A weight that is off by
e moves a value by e times the difference of two neighbours. A fetch across x, y or z uses weights
along all three axes, one of which should be 0: `weight_error` bounds their sum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.neighbourhood import Layer, Neighbourhood
from vctgi.clipmap.stored_directions import StoredDirections
from vctgi.maths.directions import other_axes
from vctgi.maths.powers import reciprocal_of_power
from vctgi.maths.stub_gaps import as_component

if TYPE_CHECKING:
    from drjit.auto.ad import Texture3f16
else:
    # Dr.Jit reads the annotations of records that pass through `dr.freeze`.
    Texture3f16 = object

PADDING = 2
"""Layers that a slab has more than its level."""

WEIGHT_STEP = 2.0**-8
"""Step of the weights of a hardware texture fetch."""


@dataclass
class TextureTexels:
    """Texels in half precision in one texture.

    Attributes
    ----------
    texture
        [z, y, x, 4]: premultiplied emittance in units of the scale, and opacity.
    slab_starts
        [level]: first layer of the level's slabs.
    per_texel
        One texel along x, y, z in texture coordinates: an array, so that a texture of another size
        needs no other kernels.
    directions
        Which are stored, and where.
    scale
        One number: emittance of 1 in the texture, W m^-2 sr^-1.
    """

    texture: Texture3f16
    slab_starts: mi.Float
    per_texel: mi.Vector3f
    directions: StoredDirections
    scale: mi.Float

    @property
    def byte_count(self) -> int:
        """Bytes of the texture, padding and repetitions included.

        Dr.Jit 1.5 holds two arrays of the same size beside a texture that kernels write.
        """
        return 2 * math.prod(int(size) for size in self.texture.shape)

    def weight_error(self) -> float:
        """Bound on the sum of the errors of a fetch's three weights."""
        # Elsewhere the weights are computed.
        step = WEIGHT_STEP if dr.backend_v(mi.Float) == dr.JitBackend.CUDA else 0.0
        sizes = [int(size) for size in self.texture.shape[:3]]
        return sum(0.5 * step + 2.5 * 2.0**-24 * size for size in sizes)

    def has_axis(self, axis: int) -> bool:
        """Whether there is anything to read for travel along an axis."""
        return self.directions.has_axis(axis)

    def taps(
        self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool = True
    ) -> Iterator[tuple[mi.Float, mi.Float, mi.Vector4f]]:
        """Fetch the layer at the point, interpolated by the texture unit."""
        u, v = other_axes(layer.axis)
        places, weights = {}, {}
        for axis in (u, v):
            places[axis], weights[axis] = _clamped(around, axis)
        yield weights[u], weights[v], self._fetch(around, layer, places, active)

    def texel(self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool) -> mi.Vector4f:
        """Fetch at the centre of one texel of a layer."""
        across = other_axes(layer.axis)
        places = {
            axis: mi.Float(around.lowest[axis]) - _period_start(around, axis) for axis in across
        }
        return self._fetch(around, layer, places, active)

    def _fetch(
        self,
        around: Neighbourhood,
        layer: Layer,
        places: dict[int, mi.Float],
        active: mi.Bool | bool,
    ) -> mi.Vector4f:
        """Fetch a layer at a place across it, in voxels from the centre of the one stored first."""
        # At most one past the last, which stands there once more.
        places[layer.axis] = layer.voxel - _period_start(around, layer.axis)
        start = dr.gather(mi.Float, self.slab_starts, around.level) + 1.0
        slot, is_stored = self.directions.find(layer)
        places[2] += dr.fma(mi.Float(slot), around.resolution + float(PADDING), start)
        centre = mi.Vector3f([as_component(places[axis] + 0.5) for axis in range(3)])
        position = mi.Point3f(centre * self.per_texel)
        red, green, blue, opacity = self.texture.eval(position)
        texel = mi.Vector4f(red, green, blue, opacity)
        # Not a mask of the fetch: Dr.Jit 1.5 ends the process where it records one.
        return dr.select(mi.Bool(active & is_stored), texel, 0.0)


def _clamped(around: Neighbourhood, axis: int) -> tuple[mi.Float, mi.Float]:
    """Place within the window along one axis, and the weight of what lies there.

    Places are counted from the centre of the voxel that is stored first: in [0, resolution] where
    the weight is not 0, of which the last is the first voxel's copy, and anything elsewhere.
    """
    q, lowest = mi.Float(around.q[axis]), mi.Float(around.origin[axis])
    clamped = dr.clip(q, lowest, lowest + (around.resolution - 1.0))
    weight = dr.maximum(1.0 - dr.abs(q - clamped), 0.0)
    return clamped - _period_start(around, axis), weight


def _period_start(around: Neighbourhood, axis: int) -> mi.Float:
    """Return the voxel at or below the point that is stored first: a multiple of the resolution."""
    q = mi.Float(around.q[axis])
    return around.resolution * dr.floor(q * reciprocal_of_power(around.resolution))
