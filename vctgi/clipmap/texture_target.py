"""Writing texels into the texture that `texture.py` reads.

Kernels write them straight into the texture, whose memory is laid out in small blocks, so
neighbouring lanes write a block. Each texel of the texture is written once, what a slab repeats of
itself included: a lane computes the texel that belongs there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import TEXEL_CHANNELS, LevelTexels, half_texels
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.stored_directions import StoredDirections
from vctgi.clipmap.texel_target import stored_edges
from vctgi.clipmap.texture import PADDING, TextureTexels
from vctgi.maths.powers import BIAS, ceil_log2, power_of_two
from vctgi.maths.stub_gaps import as_component

MAX_TEXTURE_DEPTH = 16384
"""Texels along the longest edge of a 3D texture on CUDA devices of compute capability 3 on."""

BLOCK = 4
"""Texels along an edge of the blocks that neighbouring lanes write."""

LARGEST_EXPONENT = 15
"""Of the power of two that the largest emittance is stored as at most, half of what is infinite."""


def texture_depth(edges: list[int], direction_count: int) -> int:
    """Return the layers of the slabs of all levels, each level's filled up to whole blocks.

    Parameters
    ----------
    edges
        Voxels along an edge of each level.
    direction_count
        Slabs of a level.
    """
    layers = (direction_count * (edge + PADDING) for edge in edges)
    return sum(-(-count // BLOCK) * BLOCK for count in layers)


def stack_slabs(edges: list[int], direction_count: int) -> tuple[list[int], int]:
    """Return the first layer of each level's slabs, and the layers of all.

    Parameters
    ----------
    edges, direction_count
        As for `texture_depth`.

    Raises
    ------
    ValueError
        More layers than the deepest texture has.
    """
    starts = [texture_depth(edges[:level], direction_count) for level in range(len(edges))]
    depth = texture_depth(edges, direction_count)
    if depth > MAX_TEXTURE_DEPTH:
        raise ValueError(
            f'StorageConfig.format "texture16" stacks {len(edges)} levels to {depth} layers, '
            f"and a texture holds {MAX_TEXTURE_DEPTH}: use fewer or smaller levels, "
            'direction_count 3, or the format "float16".'
        )
    return starts, depth


def texture_scale(peak: mi.Float, merge_count: int) -> mi.Float:
    """Return the emittance that is stored as 1, a power of two, without asking the host.

    Parameters
    ----------
    peak
        Largest emittance of any voxel, W m^-2 sr^-1; one number, finite.
    merge_count
        How often voxels are merged two by two along a ray before they are stored, which can double
        what they emit each time.
    """
    exponent = ceil_log2(peak) + (merge_count - LARGEST_EXPONENT)
    # Of normal numbers whose reciprocals are normal.
    scale = power_of_two(dr.clip(exponent, 1 - BIAS, BIAS - 1))
    return dr.select(peak > 0.0, scale, 1.0)


def empty_texture(edges: list[int], direction_count: int) -> Any:
    """Return a texture for levels that are yet to be written.

    Parameters
    ----------
    edges, direction_count
        As for `texture_depth`.

    Raises
    ------
    ValueError
        The slabs are more than the deepest texture holds.
    """
    _, depth = stack_slabs(edges, direction_count)
    # A plain object in Mitsuba's stubs.
    return cast("Any", mi.Texture3f16)(
        (depth, max(edges), max(edges)),
        TEXEL_CHANNELS,
        filter_mode=dr.FilterMode.Linear,
        wrap_mode=dr.WrapMode.Repeat,
        writable=True,
    )


class TextureTarget:
    """A texture that is filled level by level.

    Parameters
    ----------
    texture
        What `empty_texture` returned.
    edges
        Voxels along an edge of what is stored of each level.
    directions
        Which are stored, and where.
    scale
        Emittance that is stored as 1, W m^-2 sr^-1; one number.
    """

    is_in_order = False

    def __init__(
        self, texture: Any, edges: list[int], directions: StoredDirections, scale: mi.Float
    ) -> None:
        self._texture, self._edges = texture, edges
        self._directions, self._scale = directions, scale
        self._starts, _ = stack_slabs(edges, directions.count)
        self._width = max(edges)

    def lanes(self, level: int) -> tuple[mi.UInt32, mi.UInt32]:
        """Return the stored slot and the texel [z, y, x] of a level that each lane writes."""
        edge = self._edges[level]
        x, y, z = self._places(level)
        layers = edge + PADDING
        layer = (z % layers + (edge - 1)) & (edge - 1)
        # Layers that fill up the last block are nobody's.
        slot = dr.minimum(z // layers, self._directions.count - 1)
        return slot, (layer * edge + (y & (edge - 1))) * edge + (x & (edge - 1))

    def write(self, level: int, texel: mi.Vector4f) -> None:
        """Write emittance, W m^-2 sr^-1, and opacity of the lanes of a level.

        They are written with the next evaluation.
        """
        x, y, z = self._places(level)
        per_scale = as_component(1.0 / self._scale)
        color = mi.Color3f(texel.x, texel.y, texel.z) * per_scale
        halves = half_texels(color, mi.Float(texel.w))
        place = mi.Vector3u(x, y, z + self._starts[level])
        self._texture.write(place, list(halves))

    def _places(self, level: int) -> tuple[mi.UInt32, mi.UInt32, mi.UInt32]:
        """Return the texel of the texture that each lane writes, counted from the level's first."""
        block = min(BLOCK, self._width)
        across = self._width // block
        layers = texture_depth([self._edges[level]], self._directions.count)
        lane = dr.arange(mi.UInt32, layers * self._width * self._width)
        places = []
        for edge in (block, block, BLOCK):
            places.append(lane % edge)
            lane = lane // edge
        for axis, count in enumerate((across, across, layers // BLOCK)):
            places[axis] += (block, block, BLOCK)[axis] * (lane % count)
            lane = lane // count
        x, y, z = places
        return x, y, z


def texture_texels(
    texture: Any, edges: list[int], directions: StoredDirections, scale: mi.Float
) -> TextureTexels:
    """Return how a texture that was filled is read; the arguments are those of its target."""
    starts, depth = stack_slabs(edges, directions.count)
    per_texel = mi.Vector3f(1.0 / max(edges), 1.0 / max(edges), 1.0 / depth)
    slab_starts = mi.Float(starts)
    dr.make_opaque(per_texel, slab_starts, scale)
    return TextureTexels(texture, slab_starts, per_texel, directions, scale)


def build_texture(
    levels: Sequence[LevelLayout],
    is_empty: Sequence[bool],
    texels_of: Callable[[LevelLayout], LevelTexels],
    directions: StoredDirections,
    scale: mi.Float,
) -> TextureTexels:
    """Put the texels of all levels into one texture.

    Parameters
    ----------
    levels, is_empty
        The levels, finest first, and which of them hold nothing; those get a single voxel.
    texels_of
        The texels of a level, W m^-2 sr^-1.
    directions
        Which are stored, and where.
    scale
        Emittance that is stored as 1, W m^-2 sr^-1; one number.

    Raises
    ------
    ValueError
        The slabs are more than the deepest texture holds.
    """
    edges = stored_edges([level.resolution for level in levels], is_empty)
    texture = empty_texture(edges, directions.count)
    target = TextureTarget(texture, edges, directions, scale)
    for level, empty in zip(levels, is_empty, strict=True):
        value = mi.Vector4f(0.0)
        if not empty:
            texels = texels_of(level)
            slot, texel = target.lanes(level.level)
            index = slot * level.voxel_count + texel
            color = dr.gather(mi.Color3f, texels.emittance, index)
            opacity = dr.gather(mi.Float, texels.opacity, index)
            value = mi.Vector4f(color.x, color.y, color.z, as_component(opacity))
        target.write(level.level, value)
    dr.eval()
    return texture_texels(texture, edges, directions, scale)
