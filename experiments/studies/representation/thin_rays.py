"""The one configuration of the accuracy study: 256 hair-thin rays a point through exact voxels."""

from __future__ import annotations

from collections.abc import Callable

import mitsuba as mi
import numpy as np

from experiments.studies.check import StudyContext
from experiments.studies.exact_voxels import (
    Radiance,
    lay_out_window,
    light_exactly,
    receivers,
    scene_of,
)
from experiments.studies.phases import phase_offsets
from experiments.studies.scenes import ShiningScene
from vctgi.clipmap.storage import VoxelVolume
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, trace_diffuse
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

PHASE_COUNT = 8
QUICK_PHASE_COUNT = 2


def over_phases(
    context: StudyContext, measure: Callable[[np.ndarray], np.ndarray]
) -> list[np.ndarray]:
    """Return what `measure` gives for each phase, an offset [3] in voxels."""
    offsets = phase_offsets(QUICK_PHASE_COUNT if context.quick else PHASE_COUNT)
    found = []
    for number, offset in enumerate(offsets):
        context.progress("phases of the grid", number / len(offsets))
        found.append(measure(offset))
    return found


def incident_in(context: StudyContext, key: str, scene: ShiningScene) -> list[np.ndarray]:
    """E / pi [point] at the receivers of a scene, for each phase; found once for a key."""
    layout = lay_out_window(scene.triangles)

    def at_phase(offset: np.ndarray) -> np.ndarray:
        moved = scene.moved(offset * layout.finest_voxel_size)
        world = scene_of(moved.triangles)
        volume = light_exactly(world, layout, constant_radiance(moved.radiance))
        return gather(volume, world, moved.points, moved.normals)[:, 0]

    return context.once(key, lambda: over_phases(context, at_phase))


def gather(
    volume: VoxelVolume, scene: mi.Scene, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """E / pi [point, rgb] that the rays bring to points [point, 3]."""
    found = trace_diffuse(receivers(points, normals), volume, RAYS, scene)
    return np.array(found, dtype=np.float64).T


def constant_radiance(radiance: np.ndarray) -> Radiance:
    """Return grey light that leaves each triangle alike, from radiance [triangle]."""

    def leaving(_points: np.ndarray, _normals: np.ndarray, owner: np.ndarray) -> np.ndarray:
        return np.repeat(radiance[owner][:, None], 3, axis=1)

    return leaving
