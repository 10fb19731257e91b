"""The flux that rays can see, against what leaves the lit points.

Rays along the six directions cross the whole clipmap, closely spaced. What they bring home, times
the area that each stands for, is the power that leaves the surfaces towards that direction.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, pack_volume
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone
from vctgi.stages.downsampling import downsample

RAYS_PER_VOXEL = 4
"""Rays along an edge of a voxel's face."""

THIN = 1e-4
"""Footprint over distance of a ray: so little that only the finest level is read."""

MARCH = ConeMarchConfig(min_step_voxels=0.125, start_offset_voxels=0.0, pull_back_voxels=0.0)


def seen_flux(opacity: OpacityClipmap, emittance: EmittanceClipmap) -> np.ndarray:
    """Radiance times area [direction] that rays across the finest window see, W sr^-1."""
    alphas, lit = downsample(opacity, emittance)
    assert lit is not None
    volume = pack_volume(alphas, lit)
    level = opacity.layout.levels[0]
    edge = RAYS_PER_VOXEL * level.resolution
    index = dr.arange(mi.UInt32, edge * edge)
    across = [(mi.Float(i) + 0.5) / RAYS_PER_VOXEL for i in (index % edge, index // edge)]
    found = []
    for direction in range(DIRECTION_COUNT):
        axis, sign = direction // 2, 1.0 - 2.0 * (direction % 2)
        places = list(across)
        places.insert(axis, mi.Float(0.0 if sign > 0.0 else float(level.resolution)))
        apex = (mi.Point3f(*places) + mi.Point3f(*level.origin)) * level.voxel_size
        towards = dr.zeros(mi.Vector3f, edge * edge)
        towards[axis] = sign
        ratio, phase = dr.full(mi.Float, THIN, edge * edge), dr.full(mi.Float, 1.0, edge * edge)
        active = dr.full(mi.Bool, True, edge * edge)
        sample = march_cone(volume, apex, towards, ratio, phase, MARCH, active)
        area = (level.voxel_size / RAYS_PER_VOXEL) ** 2
        found.append(float(np.array(sample.radiance, dtype=np.float64)[1].sum()) * area)
    return np.array(found)


def leaving_flux(maps: list[ReflectiveShadowMap]) -> np.ndarray:
    """Radiance times projected area [direction] of the lit points, W sr^-1.

    The room is convex: a ray from outside comes in through the back of a wall and sees the next.
    """
    total = np.zeros(DIRECTION_COUNT)
    for each in maps:
        flux = np.array(each.reflected_flux, dtype=np.float64)[1] / np.pi
        normal = np.array(each.normal, dtype=np.float64)
        for axis in range(3):
            total[2 * axis] += flux @ np.maximum(-normal[axis], 0.0)
            total[2 * axis + 1] += flux @ np.maximum(normal[axis], 0.0)
    return total
