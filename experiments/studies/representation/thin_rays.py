"""The one configuration of the accuracy study: 256 hair-thin rays a point through exact voxels."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from experiments.studies import tracers
from experiments.studies.tracers import Bench
from vctgi.clipmap.storage import VoxelVolume
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.cone_tracing.march import ConeMarchConfig

RAYS = DiffuseConesConfig(
    cone_count=256,
    # So thin that every sample is read from the finest level.
    aperture_scale=1e-3,
    near_field_voxels=2.0,
    march=ConeMarchConfig(
        level_bias=0.0, min_step_voxels=0.5, start_offset_voxels=1.0, pull_back_voxels=0.25
    ),
)
"""Rays that leave nothing to the width of a cone."""

CONFIGURATION = (
    "256 hair-thin rays a point, N = 64, exact light, near field of "
    f"{RAYS.near_field_voxels:g} voxels, steps of {RAYS.march.min_step_voxels:g} voxels, "
    f"start at {RAYS.march.start_offset_voxels:g}, pull-back {RAYS.march.pull_back_voxels:g}, "
    "no normal offset"
)
"""The same in words, for the table."""

NAME = "thin rays"

BENCH = Bench(name=NAME, tracers={NAME: RAYS})
"""The rays in voxels with exact light."""


def gather(
    volume: VoxelVolume, scene: mi.Scene, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """E / pi [point, rgb] that the rays bring to points [point, 3]."""
    return tracers.gather(volume, scene, points, normals, RAYS)
