"""Surfaces as triangles on the device, in double precision."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.scene.surfaces import VoxelSurfaces

FLAT_NORMAL = 1e-6
"""Normal components below this are the rounding of single-precision vertices."""


@dataclass
class DeviceTriangles:
    """Triangles to voxelize.

    Attributes
    ----------
    corners
        For each of three corners the flat world coordinates [axis, triangle].
    normal
        Flat unit geometric normals [axis, triangle]; exactly 0 where a component is rounding.
    uv
        Three texture coordinates.
    count
        Number of triangles.
    mask
        For each triangle the BSDF whose null transmission thins its coverage, as a number of
        Dr.Jit's registry; None for opaque triangles.
    """

    corners: list[mi.Float64]
    normal: mi.Float
    uv: list[mi.Point2f]
    count: int
    mask: mi.UInt32 | None


def upload_triangles(surfaces: VoxelSurfaces) -> list[DeviceTriangles]:
    """Copy surfaces to the device, one batch for the opaque ones and one for those with masks."""
    batches = []
    numbers = np.array([registry_number(mask) for mask in surfaces.masks], dtype=np.uint32)
    for has_mask in (False, True):
        chosen = np.flatnonzero((surfaces.mask_index >= 0) == has_mask)
        if len(chosen) == 0:
            continue
        vertices = surfaces.vertices[chosen]
        normal = unit_normals(vertices)
        batches.append(
            DeviceTriangles(
                corners=[
                    mi.Float64(np.ascontiguousarray(vertices[:, corner].T).ravel())
                    for corner in range(3)
                ],
                normal=mi.Float(np.ascontiguousarray(normal.T.astype(np.float32)).ravel()),
                uv=[
                    mi.Point2f(np.ascontiguousarray(surfaces.uv[chosen, c].T.astype(np.float32)))
                    for c in range(3)
                ],
                count=len(chosen),
                mask=mi.UInt32(numbers[surfaces.mask_index[chosen]]) if has_mask else None,
            )
        )
    return batches


def unit_normals(vertices: np.ndarray) -> np.ndarray:
    """Geometric normals [triangle, 3] of triangles [triangle, corner, 3]."""
    normal = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # A wall that rounding tilts a little must not gain a slot across its plane.
    normal[np.abs(normal) < FLAT_NORMAL] = 0.0
    return normal


def registry_number(bsdf: mi.BSDF) -> int:
    """Return the number by which Dr.Jit knows a BSDF."""
    return int(mi.UInt32(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdf)))[0])
