"""Surfaces as triangles on the device, in double precision."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.scene.registry import registry_number
from vctgi.scene.surfaces import VoxelSurfaces

FLAT_NORMAL = 1e-6
"""Normal components below this are the rounding of single-precision vertices."""


NO_MASK = 0
"""Number of no BSDF."""


@dataclass
class DeviceTriangles:
    """Triangles to voxelize.

    Attributes
    ----------
    corners
        For each of three corners the flat world coordinates [axis, triangle], with derivatives
        where vertices have them.
    low, high
        Flat bounds [axis, triangle], rounded outwards to single precision.
    normal
        Flat unit geometric normals [axis, triangle]; exactly 0 where a component is rounding.
    uv
        Three texture coordinates; none where nothing reads them.
    count
        Number of triangles.
    mask
        For each triangle the BSDF whose null transmission thins its coverage, as a number of
        Dr.Jit's registry, or `NO_MASK`; None if all triangles are opaque.
    """

    corners: list[mi.Float64]
    low: mi.Float
    high: mi.Float
    normal: mi.Float
    uv: list[mi.Point2f]
    count: int
    mask: mi.UInt32 | None


def upload_triangles(
    surfaces: VoxelSurfaces, *, has_uv: bool = True, has_masks: bool | None = None
) -> DeviceTriangles:
    """Copy surfaces to the device.

    Parameters
    ----------
    surfaces
        What is voxelized.
    has_uv
        Whether their texture coordinates are read.
    has_masks
        Whether they are tested for alpha; None: if any has a mask.
    """
    vertices = surfaces.vertices
    has_masks = bool(surfaces.masks) if has_masks is None else has_masks
    # The last number belongs to no mask, whose index is -1.
    masks = (registry_number(mi.BSDFPtr(each)) for each in surfaces.masks)
    numbers = np.array([*masks, NO_MASK], dtype=np.uint32)
    return DeviceTriangles(
        corners=[_corners(surfaces, corner) for corner in range(3)],
        low=mi.Float(_rounded(vertices.min(axis=1), -np.inf)),
        high=mi.Float(_rounded(vertices.max(axis=1), np.inf)),
        normal=mi.Float(np.ascontiguousarray(unit_normals(vertices).T.astype(np.float32)).ravel()),
        uv=[
            mi.Point2f(np.ascontiguousarray(surfaces.uv[:, corner].T.astype(np.float32)))
            for corner in range(3)
            if has_uv or has_masks
        ],
        count=len(vertices),
        mask=mi.UInt32(numbers[surfaces.mask_index]) if has_masks else None,
    )


def _corners(surfaces: VoxelSurfaces, corner: int) -> mi.Float64:
    """Return the flat coordinates [axis, triangle] of a corner of each triangle."""
    values = mi.Float64(np.ascontiguousarray(surfaces.vertices[:, corner].T).ravel())
    if surfaces.live is None:
        return values
    index = mi.UInt32(surfaces.live.index[:, corner].astype(np.uint32))
    moved = dr.gather(mi.Point3f, surfaces.live.positions, index)
    live = dr.concat([mi.Float64(mi.Float(moved[axis])) for axis in range(3)])
    # Values of the host's double precision, derivatives of the live ones: what is added is zero.
    return mi.Float64(values + (live - dr.detach(live)))


def _rounded(points: np.ndarray, towards: float) -> np.ndarray:
    """Return points [triangle, axis] flat as [axis, triangle], in single precision."""
    single = points.T.astype(np.float32)
    # One step further than the nearest number, which may lie on the wrong side.
    outward: np.ndarray = np.nextafter(single, np.float32(towards)).ravel()
    return outward


def unit_normals(vertices: np.ndarray) -> np.ndarray:
    """Geometric normals [triangle, 3] of triangles [triangle, corner, 3]."""
    normal = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # A wall that rounding tilts a little must not gain a slot across its plane.
    normal[np.abs(normal) < FLAT_NORMAL] = 0.0
    return normal
