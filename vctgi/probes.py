"""Irradiance by cones at points in space with a normal, without a camera."""

from __future__ import annotations

import math
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike

from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.maths.directions import random_bits
from vctgi.prepared import PreparedScene
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse

UNIT_TOLERANCE = 1e-3
"""By how much the length of a normal may differ from one."""


def probe_irradiance(
    prepared: PreparedScene,
    volume: VoxelVolume,
    config: RenderConfig,
    points: ArrayLike,
    normals: ArrayLike,
    seed: int = 0,
) -> np.ndarray:
    """Irradiance of indirect light that small plane probes receive on the side of their normals.

    The diffuse cones of `render_frame`, from given points: light that at least one surface has
    scattered, and the sky where the plan gives it to the cones.

    Parameters
    ----------
    prepared, volume
        Scene and its lit voxels.
    config
        Cones; `samples_per_pixel` sets of them are averaged, each with another random turn.
    points
        World points `[probe, 3]`, on surfaces or in free space, inside the outermost clip level.
    normals
        Unit normals `[probe, 3]`.
    seed
        Chooses the random turns and phases of the cones, >= 0.

    Returns
    -------
    np.ndarray
        Float64 `[probe, rgb]`, W m^-2: pi times what `trace_diffuse` returns.

    Raises
    ------
    ValueError
        Points or normals are not as above, or the mode has no light.
    """
    if config.mode == "ambient":
        raise ValueError(
            'probe_irradiance: the mode "ambient" has no light; use a preset that lights voxels.'
        )
    at, normal = _checked_probes(points, normals)
    sky = prepared.sky if prepared.plan.has_sky_in_cones else None
    count = len(at)
    total = np.zeros((count, 3))
    probes = white_receivers(at, normal)
    lane = dr.arange(mi.UInt32, count)
    for number in range(config.samples_per_pixel):
        stream = dr.opaque(mi.UInt32, number + seed * config.samples_per_pixel)
        sample_index = random_bits(lane, stream)
        incident = trace_diffuse(
            replace(probes, sample_index=sample_index),
            volume,
            config.diffuse,
            prepared.scene,
            sky,
        )
        total += np.array(incident, dtype=np.float64).T
    irradiance: np.ndarray = math.pi * total / config.samples_per_pixel
    return irradiance


def _checked_probes(points: ArrayLike, normals: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return points and unit normals as float32 `[probe, 3]`, or refuse them."""
    at, normal = (np.asarray(each, np.float32) for each in (points, normals))
    if at.ndim != 2 or at.shape[1:] != (3,) or at.shape != normal.shape or not len(at):
        raise ValueError(
            f"probe_irradiance: points and normals must both have the shape [probe, 3] with at "
            f"least one probe, got {at.shape} and {normal.shape}."
        )
    if not (np.isfinite(at).all() and np.isfinite(normal).all()):
        raise ValueError("probe_irradiance: points and normals must be finite; drop those probes.")
    length = np.linalg.norm(normal, axis=1)
    if (np.abs(length - 1.0) > UNIT_TOLERANCE).any():
        raise ValueError(
            f"probe_irradiance: normals must have unit length, one has {length.min():g} and one "
            f"{length.max():g}; divide them by their lengths."
        )
    return at, normal
