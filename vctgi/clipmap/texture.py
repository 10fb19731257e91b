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

The texture unit rounds its weights to 2^-8, so by 2^-9 at most, and places are normalised to [0, 1]
and back in single precision: five roundings of 2^-25 of the texture's size. A weight that is off by
e moves a value by e times the difference of two neighbours. A fetch across x, y or z uses weights
along all three axes, one of which should be 0: `weight_error` bounds their sum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import TEXEL_CHANNELS, LevelTexels, half_texels
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.neighbourhood import Layer, Neighbourhood
from vctgi.clipmap.stored_directions import StoredDirections
from vctgi.maths.directions import other_axes
from vctgi.maths.stub_gaps import as_component, as_mask

if TYPE_CHECKING:
    from drjit.auto.ad import Texture3f16
else:
    # Dr.Jit reads the annotations of records that pass through `dr.freeze`.
    Texture3f16 = object

MAX_TEXTURE_DEPTH = 16384
"""Texels along the longest edge of a 3D texture on CUDA devices of compute capability 3 on."""

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
        [z, y, x, 4]: premultiplied emittance, W m^-2 sr^-1, and opacity.
    slab_starts
        [level]: first layer of the level's slabs.
    per_texel
        One texel along x, y, z in texture coordinates: an array, so that a texture of another size
        needs no other kernels.
    directions
        Which are stored, and where.
    """

    texture: Texture3f16
    slab_starts: mi.UInt32
    per_texel: mi.Vector3f
    directions: StoredDirections

    @property
    def byte_count(self) -> int:
        """Bytes of the texture, padding and repetitions included."""
        return 2 * math.prod(int(size) for size in self.texture.shape)

    def weight_error(self) -> float:
        """Bound on the sum of the errors of a fetch's three weights."""
        step = WEIGHT_STEP if self.texture.use_accel() else 0.0
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
        places = {axis: mi.Float(around.stored(mi.Int32(around.lowest[axis]))) for axis in across}
        return self._fetch(around, layer, places, active)

    def _fetch(
        self,
        around: Neighbourhood,
        layer: Layer,
        places: dict[int, mi.Float],
        active: mi.Bool | bool,
    ) -> mi.Vector4f:
        """Fetch a layer at a place across it, in voxels from the centre of the one stored first."""
        places[layer.axis] = mi.Float(around.stored(layer.voxel))
        start = dr.gather(mi.UInt32, self.slab_starts, around.level)
        slot, is_stored = self.directions.find(layer)
        below = start + slot * (around.resolution + PADDING) + 1
        places[2] += mi.Float(below)
        centre = mi.Vector3f([as_component(places[axis] + 0.5) for axis in range(3)])
        position = mi.Point3f(centre * self.per_texel)
        return mi.Vector4f(*self.texture.eval(position, as_mask(active & is_stored)))


def build_texture(
    levels: list[LevelLayout],
    is_empty: list[bool],
    texels_of: Callable[[LevelLayout], LevelTexels],
    directions: StoredDirections,
    *,
    use_accel: bool = True,
) -> TextureTexels:
    """Put the texels of all levels into one texture.

    Parameters
    ----------
    levels
        The levels, finest first.
    is_empty
        Which of them hold nothing; they get a single voxel.
    texels_of
        The texels of a level.
    directions
        Which are stored, and where.
    use_accel
        Whether a GPU's texture units interpolate, or the same is computed.

    Raises
    ------
    ValueError
        The slabs are more than the deepest texture holds.
    """
    edges = [
        1 if empty else level.resolution for level, empty in zip(levels, is_empty, strict=True)
    ]
    starts, depth = stack_slabs(edges, directions.count)
    width = max(edges)
    words = dr.zeros(mi.Float16, TEXEL_CHANNELS * depth * width * width)
    for level, empty, start in zip(levels, is_empty, starts, strict=True):
        if not empty:
            _write_slabs(words, texels_of(level), level.resolution, start, width)
    tensor = mi.TensorXf16(words, shape=(depth, width, width, TEXEL_CHANNELS))
    texture = mi.Texture3f16(  # type: ignore[operator]  # a plain object in Mitsuba's stubs
        tensor,
        use_accel=use_accel,
        migrate=use_accel,
        filter_mode=dr.FilterMode.Linear,
        wrap_mode=dr.WrapMode.Repeat,
    )
    per_texel = mi.Vector3f(1.0 / width, 1.0 / width, 1.0 / depth)
    dr.make_opaque(per_texel)
    return TextureTexels(texture, mi.UInt32(starts), per_texel, directions)


def stack_slabs(edges: list[int], direction_count: int) -> tuple[list[int], int]:
    """Return the first layer of each level's slabs, and the layers of all.

    Parameters
    ----------
    edges
        Voxels along an edge of each level.
    direction_count
        Slabs of a level.

    Raises
    ------
    ValueError
        More layers than the deepest texture has.
    """
    starts = [0]
    for edge in edges:
        starts.append(starts[-1] + direction_count * (edge + PADDING))
    if starts[-1] > MAX_TEXTURE_DEPTH:
        raise ValueError(
            f'StorageConfig.format "texture16" stacks {len(edges)} levels to {starts[-1]} layers, '
            f"and a texture holds {MAX_TEXTURE_DEPTH}: use fewer or smaller levels, "
            'direction_count 3, or the format "float16".'
        )
    return starts[:-1], starts[-1]


def _write_slabs(
    words: mi.Float16, texels: LevelTexels, resolution: int, start: int, width: int
) -> None:
    """Write the slabs of a level, with what they repeat of themselves."""
    layers = resolution + PADDING
    target = dr.arange(mi.UInt32, texels.direction_count * layers * width * width)
    x, y, z = target % width, (target // width) % width, target // (width * width)
    slot, layer = z // layers, (z % layers + (resolution - 1)) & (resolution - 1)
    source = slot * resolution + layer
    for place in (y, x):
        source = source * resolution + (place & (resolution - 1))
    color = dr.gather(mi.Color3f, texels.emittance, source)
    opacity = dr.gather(mi.Float, texels.opacity, source)
    dr.scatter(words, half_texels(color, opacity), target + start * width * width)
    dr.eval(words)


def _clamped(around: Neighbourhood, axis: int) -> tuple[mi.Float, mi.Float]:
    """Place within the window along one axis, [0, resolution), and the weight of what lies there.

    Places are counted from the centre of the voxel that is stored first.
    """
    q = mi.Float(around.q[axis])
    lowest = mi.Float(around.origin[axis])
    highest = mi.Float(around.origin[axis] + mi.Int32(around.resolution) - 1)
    clamped = dr.clip(q, lowest, highest)
    weight = dr.maximum(1.0 - dr.abs(q - clamped), 0.0)
    # Exact: the resolution is a power of two.
    edge = mi.Float(around.resolution)
    return clamped - edge * dr.floor(clamped / edge), weight
