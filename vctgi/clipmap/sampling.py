"""The layered read: extinction and source of the voxels around a point, as a ray meets them.

One opacity plays two parts. Across the ray a half-covered voxel is half open, so opacity is
interpolated as alpha, bilinearly within a layer of voxels. Along the ray a wall is a wall however
the samples fall, so what is interpolated linearly between two layers is optical depth. Derived and
measured in docs/decisions/0001.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slots import BEHIND_NUDGE, surface_slot
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.directions import DIRECTION_COUNT, other_axes
from vctgi.maths.stub_gaps import as_component

OPTICAL_DEPTH_CAP = 6.0
"""Largest optical depth of one voxel. An opaque voxel lets exp(-6) = 0.25 % through, and the
derivative of the depth by opacity stays below exp(6)."""

THIN_OPACITY = 1e-4
"""Below this opacity a, depth / a is 1 + a / 2 to single precision."""


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
class _Corners:
    """The 2^3 voxels around a point: for each axis two weights and two parts of an address."""

    weights: list[tuple[mi.Float, mi.Float]]
    parts: list[tuple[mi.UInt32, mi.UInt32]]  # what each axis adds to the address

    def address(self, steps: list[int]) -> mi.UInt32:
        """Address within a slot of the voxel at steps 0 or 1 along x, y, z."""
        x, y, z = (self.parts[axis][steps[axis]] for axis in range(3))
        return x + y + z


def read_medium(
    volume: VoxelVolume, level: mi.UInt32, p_world: mi.Point3f, direction: mi.Vector3f
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

    Returns
    -------
    Medium
        Sum over the axes k of |direction_k| times the optical depth of the slot that faces the
        ray, over the voxel size: the projected-area rule.
    """
    row = dr.gather(mi.Vector4i, volume.table.origins, level)
    offset = dr.gather(mi.UInt32, volume.table.voxel_offsets, level)
    voxel_size = volume.layout.finest_voxel_size * dr.exp2(mi.Float(level))
    corners = _corners(p_world / as_component(voxel_size) - 0.5, row)
    slot_stride = mi.UInt32(1) << (3 * mi.UInt32(row.w))

    extinction = mi.Float(0.0)
    source = mi.Color3f(0.0)
    for axis in range(3):
        towards_lower = dr.select(direction[axis] < 0.0, mi.UInt32(1), mi.UInt32(0))
        base = offset * DIRECTION_COUNT + (2 * axis + towards_lower) * slot_stride
        depth, emitted = _read_axis(volume.texels, corners, base, axis)
        share = as_component(dr.abs(direction[axis]) / voxel_size)
        extinction = dr.fma(share, depth, extinction)
        source = dr.fma(share, emitted, source)
    return Medium(extinction, source)


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
    row = dr.gather(mi.Vector4i, volume.table.origins, level)
    offset = dr.gather(mi.UInt32, volume.table.voxel_offsets, level)
    bits = mi.UInt32(row.w)
    per_voxel = 1.0 / (volume.layout.finest_voxel_size * dr.exp2(mi.Float(level)))
    q = p_world * as_component(per_voxel)
    across = _corners(q - 0.5, row)
    total = mi.Vector4f(0.0)
    for axis in range(3):
        u, v = other_axes(axis)
        slot = surface_slot(mi.Float(normal[axis]))
        layer = mi.Int32(dr.floor(q[axis] + as_component(mi.Float(slot.behind) * BEHIND_NUDGE)))
        resolution = mi.UInt32(1) << bits
        is_held = active & (mi.UInt32(layer - row[axis]) < resolution)
        stored = (mi.UInt32(layer) & (resolution - 1)) << (axis * bits)
        base = offset * DIRECTION_COUNT + ((2 * axis + slot.side) << (3 * bits)) + stored
        share = mi.Float(dr.abs(normal[axis]))
        for step_u in range(2):
            for step_v in range(2):
                weight = share * across.weights[u][step_u] * across.weights[v][step_v]
                address = base + across.parts[u][step_u] + across.parts[v][step_v]
                texel = dr.gather(mi.Vector4f, volume.texels, address, is_held)
                total = dr.fma(as_component(weight), texel, total)
    opacity = mi.Float(total.w)
    is_known = opacity > 0.0
    emitted = mi.Color3f(total.x, total.y, total.z)
    radiance = emitted / as_component(dr.select(is_known, opacity, 1.0))
    return dr.select(is_known, radiance, 0.0), opacity


def _corners(q: mi.Point3f, row: mi.Vector4i) -> _Corners:
    """Weights and addresses of the voxels around `q`, in voxels from voxel centre 0."""
    lowest = dr.floor(q)
    fraction = q - lowest
    voxel = mi.Vector3i(lowest)
    resolution = mi.UInt32(1) << mi.UInt32(row.w)
    weights: list[tuple[mi.Float, mi.Float]] = []
    parts: list[tuple[mi.UInt32, mi.UInt32]] = []
    for axis in range(3):
        pair = []
        for step in range(2):
            weight = mi.Float(fraction[axis] if step else 1.0 - fraction[axis])
            # An unsigned comparison tests both ends of the window at once.
            is_held = mi.UInt32(voxel[axis] + step - row[axis]) < resolution
            stored = mi.UInt32(voxel[axis] + step) & (resolution - 1)
            pair.append((dr.select(is_held, weight, 0.0), stored << (axis * mi.UInt32(row.w))))
        weights.append((pair[0][0], pair[1][0]))
        parts.append((pair[0][1], pair[1][1]))
    return _Corners(weights, parts)


def _read_axis(
    texels: mi.Float, corners: _Corners, base: mi.UInt32, axis: int
) -> tuple[mi.Float, mi.Color3f]:
    """Optical depth of one voxel along `axis`, and the radiance emitted over that depth."""
    u, v = other_axes(axis)
    depth = mi.Float(0.0)
    emitted = mi.Color3f(0.0)
    for along in range(2):
        texel = mi.Vector4f(0.0)
        for step_u in range(2):
            for step_v in range(2):
                steps = [0, 0, 0]
                steps[axis], steps[u], steps[v] = along, step_u, step_v
                address = base + corners.address(steps)
                weight = corners.weights[u][step_u] * corners.weights[v][step_v]
                texel = dr.fma(as_component(weight), dr.gather(mi.Vector4f, texels, address), texel)
        layer_weight = corners.weights[axis][along]
        layer_depth, depth_per_opacity = optical_depth(mi.Float(texel.w))
        depth = dr.fma(layer_weight, layer_depth, depth)
        layer_emitted = mi.Color3f(texel.x, texel.y, texel.z) * as_component(depth_per_opacity)
        emitted = dr.fma(as_component(layer_weight), layer_emitted, emitted)
    return depth, emitted


def optical_depth(opacity: mi.Float) -> tuple[mi.Float, mi.Float]:
    """Optical depth -ln(1 - opacity), capped at `OPTICAL_DEPTH_CAP`, and its ratio to opacity.

    The cap keeps the depth and its derivative bounded near opacity 1; what passes an opaque voxel
    is exp(-6) = 0.0025 instead of 0.
    """
    depth = -dr.log(1.0 - dr.minimum(opacity, 1.0 - math.exp(-OPTICAL_DEPTH_CAP)))
    is_thin = opacity < THIN_OPACITY
    ratio = dr.select(is_thin, dr.fma(0.5, opacity, 1.0), depth / dr.select(is_thin, 1.0, opacity))
    return depth, ratio
