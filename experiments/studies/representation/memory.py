"""Memory of voxelization: bytes a voxel in each format, and how the peak grows.

The peak is what Dr.Jit's allocator held at most during one voxelization of wavy sheets, surfaces
and result included. It must grow in proportion: with the voxels, and with the triangles.
"""

from __future__ import annotations

import gc
from functools import partial
from typing import get_args

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.representation.speed_scenes import sheets
from vctgi.clipmap.storage import CODES, StorageConfig, StorageFormat, bytes_per_voxel
from vctgi.stages.voxelization.opacity import voxelize_opacity

RESOLUTIONS = (32, 64, 128, 256)
TRIANGLE_COUNTS = (10**4, 10**5, 10**6, 10**7)

QUICK_RESOLUTIONS = RESOLUTIONS[:3]
QUICK_TRIANGLE_COUNTS = TRIANGLE_COUNTS[:3]

LINEAR = 1.05
"""Largest exponent of growth between the two largest sizes that still counts as linear."""

COMPACT = {"rgb10a2": (16.0, 32.0), "rgba8": (16.0, 32.0), "srgb8": (16.0, 32.0)}
"""Bytes a voxel of six directions in the talk."""

MIB = 2.0**20


def checks() -> list[Check]:
    """Return the checks of memory."""
    found = []
    for name in filter(CODES.__contains__, get_args(StorageFormat)):
        low, high = COMPACT.get(name, (None, None))
        found.append(
            Check(
                name=f"memory: bytes a voxel, {name}",
                configuration="six directions",
                scene="none",
                measure=partial(_bytes, name=name),
                limit_low=low,
                limit_high=high,
            )
        )
    found += [
        Check(
            name=f"memory: peak with {resolution}^3, MiB",
            configuration="5 levels, 10^5 triangles",
            scene="wavy sheets",
            measure=partial(_peak_of, triangle_count=10**5, resolution=resolution),
        )
        for resolution in RESOLUTIONS
    ]
    found.append(
        Check(
            name="memory: exponent of growth with the voxels",
            configuration="5 levels, 10^5 triangles",
            scene="wavy sheets",
            measure=_voxel_growth,
            limit_high=LINEAR,
        )
    )
    found += [
        Check(
            name=f"memory: peak with {count:,} triangles, MiB",
            configuration="5 levels of 64^3",
            scene="wavy sheets",
            measure=partial(_peak_of, triangle_count=count, resolution=64),
        )
        for count in TRIANGLE_COUNTS
    ]
    found.append(
        Check(
            name="memory: exponent of growth with the triangles",
            configuration="5 levels of 64^3",
            scene="wavy sheets",
            measure=_triangle_growth,
            limit_high=LINEAR,
        )
    )
    return found


def _bytes(context: StudyContext, *, name: StorageFormat) -> Measured:
    return Measured(value=float(bytes_per_voxel(StorageConfig(format=name))))


def _peak_of(context: StudyContext, *, triangle_count: int, resolution: int) -> Measured:
    """Measure one size; in the quick version the largest ones are those of the next smaller."""
    if context.quick:
        triangle_count = min(triangle_count, QUICK_TRIANGLE_COUNTS[-1])
        resolution = min(resolution, QUICK_RESOLUTIONS[-1])
    return Measured(value=_peak(context, triangle_count, resolution) / MIB)


def _peak(context: StudyContext, triangle_count: int, resolution: int) -> float:
    def measure() -> float:
        scene = sheets(triangle_count, resolution)
        backend = dr.backend_v(mi.Float)
        gc.collect()
        dr.sync_thread()
        dr.flush_malloc_cache()
        dr.detail.malloc_clear_statistics()
        before = dr.detail.malloc_watermark(backend)
        opacity = voxelize_opacity(scene.surfaces, scene.layout)
        dr.eval(opacity.levels)
        dr.sync_thread()
        return float(dr.detail.malloc_watermark(backend) - before)

    return context.once(f"memory: {triangle_count}, {resolution}", measure)


def _voxel_growth(context: StudyContext) -> Measured:
    sizes = QUICK_RESOLUTIONS if context.quick else RESOLUTIONS
    peaks = [_peak(context, 10**5, size) for size in sizes[-2:]]
    return Measured(value=float(np.log(peaks[1] / peaks[0]) / np.log((sizes[-1] / sizes[-2]) ** 3)))


def _triangle_growth(context: StudyContext) -> Measured:
    counts = QUICK_TRIANGLE_COUNTS if context.quick else TRIANGLE_COUNTS
    peaks = [_peak(context, count, 64) for count in counts[-2:]]
    return Measured(value=float(np.log(peaks[1] / peaks[0]) / np.log(counts[-1] / counts[-2])))
