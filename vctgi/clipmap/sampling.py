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

from vctgi.clipmap.neighbourhood import Layer, Neighbourhood, VoxelTexels, neighbourhood
from vctgi.clipmap.slots import BEHIND_NUDGE, surface_slot
from vctgi.clipmap.storage import VoxelVolume
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

    Returns
    -------
    Medium
        Sum over the axes k of |direction_k| times the optical depth of the slot that faces the
        ray, over the voxel size: the projected-area rule, unless `weights` say otherwise.
    """
    around, voxel_size = _around(volume, level, p_world)
    shares = _axis_shares(direction, weights)
    read_axis = _read_axis if read == "layered" else _read_axis_as_alpha
    if _is_chosen(volume):
        read_axis = _read_chosen
    extinction = mi.Float(0.0)
    source = mi.Color3f(0.0)
    for axis in filter(volume.texels.has_axis, range(3)):
        depth, emitted = read_axis(volume.texels, around, axis, _side(direction, axis))
        share = as_component(shares[axis] / voxel_size)
        extinction = dr.fma(share, depth, extinction)
        source = dr.fma(share, emitted, source)
    return Medium(extinction, source)


def read_sample(
    volume: VoxelVolume,
    level: mi.UInt32,
    p_world: mi.Point3f,
    direction: mi.Vector3f,
    weights: WeightRule,
) -> VoxelSample:
    """Return trilinearly interpolated opacity and emittance, as most systems read them.

    Parameters
    ----------
    volume, level, p_world, direction
        As for `read_medium`.
    weights
        How the three slots are put together. "projected" ones sum to more than 1 for a slanted
        ray; opacity ends at 1 then.
    """
    around, _ = _around(volume, level, p_world)
    read_axis = _chosen_texel if _is_chosen(volume) else _trilinear
    shares = _axis_shares(direction, weights)
    total = mi.Vector4f(0.0)
    for axis in filter(volume.texels.has_axis, range(3)):
        texel = read_axis(volume.texels, around, axis, _side(direction, axis))
        total = dr.fma(as_component(shares[axis]), texel, total)
    emitted = mi.Color3f(total.x, total.y, total.z)
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
    per_voxel = 1.0 / (volume.layout.finest_voxel_size * dr.exp2(mi.Float(level)))
    q = p_world * as_component(per_voxel)
    around = neighbourhood(volume.table, level, mi.Point3f(q - 0.5))
    total = mi.Vector4f(0.0)
    for axis in filter(volume.texels.has_axis, range(3)):
        slot = surface_slot(mi.Float(normal[axis]))
        layer = mi.Int32(dr.floor(q[axis] + as_component(mi.Float(slot.behind) * BEHIND_NUDGE)))
        is_held = active & around.is_held(layer, axis)
        share = mi.Float(dr.abs(normal[axis]))
        taps = volume.texels.taps(around, Layer(axis, slot.side, layer), is_held)
        for weight_u, weight_v, texel in taps:
            total = dr.fma(as_component(share * weight_u * weight_v), texel, total)
    opacity = mi.Float(total.w)
    is_known = opacity > 0.0
    emitted = mi.Color3f(total.x, total.y, total.z)
    radiance = emitted / as_component(dr.select(is_known, opacity, 1.0))
    return dr.select(is_known, radiance, 0.0), opacity


def _around(
    volume: VoxelVolume, level: mi.UInt32, p_world: mi.Point3f
) -> tuple[Neighbourhood, mi.Float]:
    """Return the voxels around a point of a level, of which one may be chosen, and their size."""
    voxel_size = volume.layout.finest_voxel_size * dr.exp2(mi.Float(level))
    q = mi.Point3f(p_world / as_component(voxel_size) - 0.5)
    if volume.choice is not None and volume.choice.offset is not None:
        q = mi.Point3f(q + volume.choice.offset)
    return neighbourhood(volume.table, level, q), voxel_size


def _is_chosen(volume: VoxelVolume) -> bool:
    """Whether one texel of each axis is chosen, the lowest of those around a moved point."""
    return volume.choice is not None and volume.choice.offset is not None


def _chosen_texel(
    texels: VoxelTexels, around: Neighbourhood, axis: int, side: mi.UInt32
) -> mi.Vector4f:
    """Premultiplied emittance and opacity of the one texel that is read."""
    is_held = mi.Bool(True)
    for each in range(3):
        is_held &= around.is_held(mi.Int32(around.lowest[each]), each)
    return texels.texel(around, Layer(axis, side, mi.Int32(around.lowest[axis])), is_held)


def _read_chosen(
    texels: VoxelTexels, around: Neighbourhood, axis: int, side: mi.UInt32
) -> tuple[mi.Float, mi.Color3f]:
    """As `_read_axis`, of the one texel that is read."""
    return _over_depth(_chosen_texel(texels, around, axis, side))


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


def _read_axis_as_alpha(
    texels: VoxelTexels, around: Neighbourhood, axis: int, side: mi.UInt32
) -> tuple[mi.Float, mi.Color3f]:
    """As `_read_axis`, of opacity that is interpolated as alpha along the axis too."""
    return _over_depth(_trilinear(texels, around, axis, side))


def _trilinear(
    texels: VoxelTexels, around: Neighbourhood, axis: int, side: mi.UInt32
) -> mi.Vector4f:
    """Premultiplied emittance and opacity of the slots of one axis."""
    total = mi.Vector4f(0.0)
    for along in range(2):
        texel = _across(texels, around, Layer(axis, side, mi.Int32(around.lowest[axis] + along)))
        total = dr.fma(as_component(around.weights[axis][along]), texel, total)
    return total


def _across(texels: VoxelTexels, around: Neighbourhood, layer: Layer) -> mi.Vector4f:
    """Premultiplied emittance and opacity of a layer, interpolated bilinearly."""
    texel = mi.Vector4f(0.0)
    for weight_u, weight_v, tap in texels.taps(around, layer):
        texel = dr.fma(as_component(weight_u * weight_v), tap, texel)
    return texel


def _read_axis(
    texels: VoxelTexels, around: Neighbourhood, axis: int, side: mi.UInt32
) -> tuple[mi.Float, mi.Color3f]:
    """Optical depth of one voxel along `axis`, and the radiance emitted over that depth."""
    depth = mi.Float(0.0)
    emitted = mi.Color3f(0.0)
    for along in range(2):
        # Across the axis: opacity is alpha, interpolated bilinearly.
        texel = _across(texels, around, Layer(axis, side, mi.Int32(around.lowest[axis] + along)))

        # Along it: what is interpolated is optical depth, and what is emitted over it.
        layer_depth, layer_emitted = _over_depth(texel)
        layer_weight = around.weights[axis][along]
        depth = dr.fma(layer_weight, layer_depth, depth)
        emitted = dr.fma(as_component(layer_weight), layer_emitted, emitted)
    return depth, emitted


def _over_depth(texel: mi.Vector4f) -> tuple[mi.Float, mi.Color3f]:
    """Optical depth of a texel's opacity, and the radiance emitted over that depth."""
    depth, depth_per_opacity = optical_depth(mi.Float(texel.w))
    return depth, mi.Color3f(texel.x, texel.y, texel.z) * as_component(depth_per_opacity)


def optical_depth(opacity: mi.Float) -> tuple[mi.Float, mi.Float]:
    """Optical depth -ln(1 - opacity), capped at `OPTICAL_DEPTH_CAP`, and its ratio to opacity.

    The cap keeps the depth and its derivative bounded near opacity 1; what passes an opaque voxel
    is exp(-6) = 0.0025 instead of 0.
    """
    depth = -dr.log(1.0 - dr.minimum(opacity, 1.0 - math.exp(-OPTICAL_DEPTH_CAP)))
    is_thin = opacity < THIN_OPACITY
    ratio = dr.select(is_thin, dr.fma(0.5, opacity, 1.0), depth / dr.select(is_thin, 1.0, opacity))
    return depth, ratio
