"""Where a point lies among the voxels of a level, and what a way of storing voxels must answer.

The read of `sampling.py` works layer by layer: one layer of voxels across an axis is interpolated
bilinearly, then layers are put together along the axis. How a layer is fetched is all that storage
formats differ in. A `VoxelTexels` therefore answers one question, the taps of a layer: four texels
of weights that the shader knows, or one that the texture unit has already interpolated. Where
texels are chosen at random (`texel_choice.py`) it is asked for a single one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import LevelTable
from vctgi.maths.powers import ceil_log2
from vctgi.maths.stub_gaps import as_component


@dataclass
class Neighbourhood:
    """The 2^3 voxels around a point of one level, in whole numbers that are stored as floats.

    Attributes
    ----------
    level
        Level, one for each lane.
    q
        The point in voxels, counted from the centre of voxel 0.
    lowest
        The voxel of the eight that is lowest along every axis.
    origin
        Lowest voxel of the level's window.
    resolution
        Voxels along an edge of the window, a power of two.
    weights
        For each axis the linear weights of the lower and upper voxel, 0 outside the window.
    """

    level: mi.UInt32
    q: mi.Point3f
    lowest: mi.Point3f
    origin: mi.Point3f
    resolution: mi.Float
    weights: list[tuple[mi.Float, mi.Float]]

    @property
    def resolution_bits(self) -> mi.UInt32:
        """Log2 of the resolution."""
        return mi.UInt32(ceil_log2(self.resolution))

    def is_held(self, voxel: mi.Float, axis: int) -> mi.Bool:
        """Whether the window reaches as far as `voxel` along `axis`."""
        lowest = self.origin[axis]
        return mi.Bool((voxel >= lowest) & (voxel < lowest + self.resolution))

    def stored(self, voxel: mi.Float) -> mi.UInt32:
        """Toroidal address of a voxel along one axis, [0, resolution)."""
        return mi.UInt32(mi.Int32(voxel)) & (mi.UInt32(self.resolution) - 1)


@dataclass
class Layer:
    """One layer of voxels across an axis, of one opacity direction.

    Attributes
    ----------
    axis
        The axis that the layer lies across.
    side
        0 for what a ray travelling towards +axis meets, 1 for -axis.
    voxel
        Where the layer lies, in voxels along the axis: one of the two around the point.
    """

    axis: int
    side: mi.UInt32
    voxel: mi.Float


class VoxelTexels(Protocol):
    """Texels in some storage format."""

    @property
    def byte_count(self) -> int:
        """Bytes that the texels take."""

    @property
    def scale(self) -> mi.Float | None:
        """Emittance of 1 in texels, W m^-2 sr^-1, one number; None: texels hold emittance."""

    def has_axis(self, axis: int) -> bool:
        """Whether there is anything to read for travel along an axis."""

    def taps(
        self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool = True
    ) -> Iterator[tuple[mi.Float, mi.Float, mi.Vector4f]]:
        """Fetch what the bilinear value of a layer at the point is the sum of.

        Parameters
        ----------
        around
            The point.
        layer
            Which layer. One outside the window gives anything finite: the caller weighs it with 0.
        active
            Lanes to fetch.

        Yields
        ------
        tuple
            Weights along the two axes of `other_axes(layer.axis)`, whose product weighs the third:
            premultiplied emittance in units of `scale`, and opacity. Voxels outside the window
            across the axis weigh 0.
        """

    def texel(self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool) -> mi.Vector4f:
        """Fetch the texel of a layer that is lowest across it: emittance and opacity as of a tap.

        Parameters
        ----------
        around
            Its lowest voxel is the one that is read.
        layer
            Which layer.
        active
            Lanes to fetch; the others get 0.
        """


def neighbourhood(table: LevelTable, level: mi.UInt32, q: mi.Point3f) -> Neighbourhood:
    """Return the voxels around points.

    Parameters
    ----------
    table
        Windows of the levels.
    level
        Level, one for each lane.
    q
        Points in voxels of their level, counted from the centre of voxel 0.
    """
    row = dr.gather(mi.Vector4f, table.windows, level)
    lowest = mi.Point3f(dr.floor(q))
    fraction = q - lowest
    around = Neighbourhood(
        level=level,
        q=q,
        lowest=lowest,
        origin=mi.Point3f(row.x, row.y, row.z),
        resolution=mi.Float(row.w),
        weights=[],
    )
    for axis in range(3):
        voxel = mi.Float(lowest[axis])
        lower, upper = mi.Float(1.0 - fraction[axis]), mi.Float(fraction[axis])
        around.weights.append(
            (
                dr.select(around.is_held(voxel, axis), lower, 0.0),
                dr.select(around.is_held(voxel + 1.0, axis), upper, 0.0),
            )
        )
    return around


def scaled(texels: VoxelTexels, color: mi.Color3f) -> mi.Color3f:
    """Return emittance, W m^-2 sr^-1, of what was made of texels in their own unit."""
    return color if texels.scale is None else mi.Color3f(color * as_component(texels.scale))
