"""The layered read: extinction and source of the voxels around a point, as a ray meets them.

One opacity plays two parts. Across the ray a half-covered voxel is half open, so opacity is
interpolated as alpha, bilinearly within a layer of voxels. Along the ray a wall is a wall however
the samples fall, so what is interpolated linearly between two layers is optical depth. Derived and
measured in docs/decisions/0001. The common recipe, one trilinear alpha and the squares of the
direction, can be read for comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.neighbourhood import (
    Layer,
    Neighbourhood,
    VoxelTexels,
    neighbourhood,
    scaled,
)
from vctgi.clipmap.slots import BEHIND_NUDGE, surface_slot
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.powers import power_of_two
from vctgi.maths.stub_gaps import as_component

OPTICAL_DEPTH_CAP = 6.0
"""Largest optical depth of one voxel. An opaque voxel lets exp(-6) = 0.25 % through, and the
derivative of the depth by opacity stays below exp(6)."""

THIN_OPACITY = 1e-4
"""Below this opacity a, depth / a is 1 + a / 2 to single precision."""


ReadRule = Literal["layered", "trilinear"]
"""How the opacity between voxels is found."""

WeightRule = Literal["projected", "squared", "normalised"]
"""How much each of the three slots counts that face a ray."""


@dataclass
class Medium:
    """What a ray meets around a point.

    Attributes
    ----------
    extinction
        Optical depth per world unit, >= 0.
    source
        Radiance that is added per world unit where nothing is in front, W m^-3 sr^-1.
    """

    extinction: mi.Float
    source: mi.Color3f


@dataclass
class VoxelSample:
    """What one voxel of the size of a level would hold at a point.

    Attributes
    ----------
    opacity
        Share of the light that it stops, [0, 1].
    emittance
        Premultiplied by opacity, W m^-2 sr^-1.
    """

    opacity: mi.Float
    emittance: mi.Color3f


def read_medium(
    volume: VoxelVolume,
    level: mi.UInt32,
    p_world: mi.Point3f,
    direction: mi.Vector3f,
    read: ReadRule = "layered",
    weights: WeightRule = "projected",
    pull_back_voxels: mi.Float | float = 0.0,
) -> Medium:
    """Return extinction and source at a point of one level for a direction of travel.

    Parameters
    ----------
    volume
        Opacity and premultiplied emittance.
    level
        Level to read, one for each lane.
    p_world
        Where to read, world units. Voxels outside the window count as empty.
    direction
        Unit direction in which the ray travels.
    read
        Whether opacity is interpolated as depth along the ray, or as alpha all over.
    weights
        How the three slots are put together.
    pull_back_voxels
        How far before the point is read, against the direction, in voxels of the level.

    Returns
    -------
    Medium
        Sum over the axes k of |direction_k| times the optical depth of the slot that faces the
        ray, over the voxel size: the projected-area rule, unless `weights` say otherwise.
    """
    around, per_voxel = _around(volume, level, p_world, direction, pull_back_voxels)
    shares = _axis_shares(direction, weights)
    extinction = mi.Float(0.0)
    source = mi.Color3f(0.0)
    for axis in filter(volume.texels.has_axis, range(3)):
        share = mi.Float(shares[axis]) * per_voxel
        for part in _parts(volume, around, axis, _side(direction, axis), read):
            opacity = mi.Float(part.texel.w) * part.across
            depth, depth_per_opacity = optical_depth(opacity)
            weight = share * part.along
            extinction = dr.fma(weight, depth, extinction)
            # The factors of a colour are few numbers, the colour is three.
            emitted = mi.Color3f(part.texel.x, part.texel.y, part.texel.z)
            source = dr.fma(as_component(weight * part.across * depth_per_opacity), emitted, source)
    return Medium(extinction, scaled(volume.texels, source))


def read_sample(
    volume: VoxelVolume,
    level: mi.UInt32,
    p_world: mi.Point3f,
    direction: mi.Vector3f,
    weights: WeightRule,
    pull_back_voxels: mi.Float | float = 0.0,
) -> VoxelSample:
    """Return trilinearly interpolated opacity and emittance, as most systems read them.

    Parameters
    ----------
    volume, level, p_world, direction, pull_back_voxels
        As for `read_medium`.
    weights
        How the three slots are put together. "projected" ones sum to more than 1 for a slanted
        ray; opacity ends at 1 then.
    """
    around, _ = _around(volume, level, p_world, direction, pull_back_voxels)
    shares = _axis_shares(direction, weights)
    total = mi.Vector4f(0.0)
    for axis in filter(volume.texels.has_axis, range(3)):
        (part,) = _parts(volume, around, axis, _side(direction, axis), "trilinear")
        total = dr.fma(as_component(shares[axis]), part.texel, total)
    emitted = scaled(volume.texels, mi.Color3f(total.x, total.y, total.z))
    return VoxelSample(dr.minimum(mi.Float(total.w), 1.0), emitted)


def read_surface(
    volume: VoxelVolume,
    level: mi.UInt32,
    p_world: mi.Point3f,
    normal: mi.Vector3f,
    active: mi.Bool,
) -> tuple[mi.Color3f, mi.Float]:
    """Return the radiance that a surface point has in its own layer of voxels.

    Parameters
    ----------
    volume
        Opacity and premultiplied emittance.
    level
        Level to read, one for each lane.
    p_world
        Points on surfaces, world units.
    normal
        Unit normals on the side that is looked at.
    active
        Lanes to read.

    Returns
    -------
    tuple
        Radiance, W m^-2 sr^-1, and the opacity of the slots that hold the surface, weighed by the
        components of the normal; both 0 where no slot holds it or the window does not.

    Notes
    -----
    Emittance and opacity are interpolated bilinearly across each axis and divided at the end, so
    that voxels which a surface hardly touches hardly count. Along the axis there is no
    interpolation: the layer is the one that the surface itself was written to.
    """
    q = p_world * as_component(_per_voxel(volume, level))
    around = neighbourhood(volume.table, level, mi.Point3f(q - 0.5))
    total = mi.Vector4f(0.0)
    for axis in filter(volume.texels.has_axis, range(3)):
        slot = surface_slot(mi.Float(normal[axis]))
        layer = mi.Float(dr.floor(q[axis] + as_component(mi.Float(slot.behind) * BEHIND_NUDGE)))
        is_held = active & around.is_held(layer, axis)
        share = mi.Float(dr.abs(normal[axis]))
        taps = volume.texels.taps(around, Layer(axis, slot.side, layer), is_held)
        for weight_u, weight_v, texel in taps:
            total = dr.fma(as_component(share * weight_u * weight_v), texel, total)
    opacity = mi.Float(total.w)
    is_known = opacity > 0.0
    emitted = scaled(volume.texels, mi.Color3f(total.x, total.y, total.z))
    radiance = emitted / as_component(dr.select(is_known, opacity, 1.0))
    return dr.select(is_known, radiance, 0.0), opacity


@dataclass
class _Part:
    """Texels of one axis that are read as one opacity.

    Attributes
    ----------
    along
        Share of the axis that they stand for.
    across
        What the texel still has to be multiplied by.
    texel
        Premultiplied emittance, in the texels' own unit, and opacity.
    """

    along: mi.Float
    across: mi.Float
    texel: mi.Vector4f


def _per_voxel(volume: VoxelVolume, level: mi.UInt32) -> mi.Float:
    """Return one over the edge of a level's voxels, 1 / world units."""
    return power_of_two(-mi.Int32(level)) * (1.0 / volume.layout.finest_voxel_size)


def _around(
    volume: VoxelVolume,
    level: mi.UInt32,
    p_world: mi.Point3f,
    direction: mi.Vector3f,
    pull_back_voxels: mi.Float | float,
) -> tuple[Neighbourhood, mi.Float]:
    """Return the voxels around a point of a level, of which one may be chosen; 1 / their size."""
    per_voxel = _per_voxel(volume, level)
    to_centre = dr.fma(direction, -pull_back_voxels, -0.5)
    q = mi.Point3f(dr.fma(p_world, as_component(per_voxel), to_centre))
    if volume.choice is not None and volume.choice.offset is not None:
        q = mi.Point3f(q + volume.choice.offset)
    return neighbourhood(volume.table, level, q), per_voxel


def _parts(
    volume: VoxelVolume, around: Neighbourhood, axis: int, side: mi.UInt32, read: ReadRule
) -> list[_Part]:
    """Read what a ray meets of the slots of one axis."""
    texels, one = volume.texels, mi.Float(1.0)
    if volume.choice is not None and volume.choice.offset is not None:
        return [_Part(one, one, _chosen_texel(texels, around, axis, side))]
    layers = []
    for along in range(2):
        layer = Layer(axis, side, mi.Float(around.lowest[axis] + float(along)))
        layers.append(_across(texels, around, layer, around.weights[axis][along]))
    if read == "layered":
        # Across the axis opacity is alpha, interpolated bilinearly. Along it what is interpolated
        # is optical depth, and what is emitted over it.
        return layers
    total = mi.Vector4f(0.0)
    for part in layers:
        total = dr.fma(as_component(part.along * part.across), part.texel, total)
    return [_Part(one, one, total)]


def _across(texels: VoxelTexels, around: Neighbourhood, layer: Layer, along: mi.Float) -> _Part:
    """Interpolate a layer bilinearly; `along` is its own weight."""
    taps = [(weight_u * weight_v, tap) for weight_u, weight_v, tap in texels.taps(around, layer)]
    if len(taps) == 1:
        # The weight of a single tap is for who uses it: it multiplies less there.
        return _Part(along, *taps[0])
    total = mi.Vector4f(0.0)
    for weight, tap in taps:
        total = dr.fma(as_component(weight), tap, total)
    return _Part(along, mi.Float(1.0), total)


def _chosen_texel(
    texels: VoxelTexels, around: Neighbourhood, axis: int, side: mi.UInt32
) -> mi.Vector4f:
    """Premultiplied emittance and opacity of the one texel that is read."""
    is_held = mi.Bool(True)
    for each in range(3):
        is_held &= around.is_held(mi.Float(around.lowest[each]), each)
    return texels.texel(around, Layer(axis, side, mi.Float(around.lowest[axis])), is_held)


def _side(direction: mi.Vector3f, axis: int) -> mi.UInt32:
    """Side of the slots that a ray meets: 0 when it travels towards +axis, 1 towards -axis."""
    return dr.select(direction[axis] < 0.0, mi.UInt32(1), mi.UInt32(0))


def _axis_shares(direction: mi.Vector3f, weights: WeightRule) -> mi.Vector3f:
    """How much the slots along each axis count."""
    if weights == "squared":
        return mi.Vector3f(direction * direction)
    projected = mi.Vector3f(dr.abs(direction))
    if weights == "normalised":
        projected /= projected.x + projected.y + projected.z
    return projected


def optical_depth(opacity: mi.Float) -> tuple[mi.Float, mi.Float]:
    """Optical depth -ln(1 - opacity), capped at `OPTICAL_DEPTH_CAP`, and its ratio to opacity.

    The cap keeps the depth and its derivative bounded near opacity 1; what passes an opaque voxel
    is exp(-6) = 0.0025 instead of 0.
    """
    depth = -dr.log(1.0 - dr.minimum(opacity, 1.0 - math.exp(-OPTICAL_DEPTH_CAP)))
    is_thin = opacity < THIN_OPACITY
    ratio = dr.select(is_thin, dr.fma(0.5, opacity, 1.0), depth / dr.select(is_thin, 1.0, opacity))
    return depth, ratio
