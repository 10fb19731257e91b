"""Points that gather diffuse light without a camera that sees them."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.scene.records import GBuffer


def white_receivers(points: np.ndarray, normals: np.ndarray) -> GBuffer:
    """Return points [point, 3] with unit normals as white diffuse surfaces, numbered in order."""
    count = len(points)
    return diffuse_receivers(
        mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(normals.T, dtype=np.float32)),
        dr.full(mi.Color3f, 1.0, count),
        dr.arange(mi.UInt32, count),
    )


def diffuse_receivers(
    position: mi.Point3f, normal: mi.Vector3f, albedo: mi.Color3f, sample_index: mi.UInt32
) -> GBuffer:
    """Return diffuse surfaces as a G-buffer, each seen along its normal from one world unit away.

    Parameters
    ----------
    position, normal
        World points and unit normals.
    albedo
        Share of light that they reflect, [0, 1].
    sample_index
        What their random decisions hash.
    """
    count = dr.width(sample_index)
    nothing = dr.zeros(mi.Color3f, count)
    return GBuffer(
        sample_index=sample_index,
        is_valid=dr.full(mi.Bool, True, count),
        position=position,
        normal=normal,
        ray_direction=-normal,
        depth=dr.full(mi.Float, 1.0, count),
        albedo=albedo,
        specular_albedo=nothing,
        specular_axis=normal,
        specular_aperture=dr.zeros(mi.Float, count),
        passed=nothing,
    )
