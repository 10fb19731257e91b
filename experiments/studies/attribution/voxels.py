"""Voxels of any scene with exact light: path-traced radiance of dense points on its surfaces.

`exact_voxels.py` does the same for a few triangles whose radiance is known; here there may be
hundreds of thousands, with any material.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.attribution.radiance import scattered_radiance
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.prepared import PreparedScene
from vctgi.stages.slot_surfaces.samples import LIFT_VOXELS, SurfaceSamples, sample_surfaces
from vctgi.stages.slot_surfaces.slots import borrow, sum_in_slots

POINTS_PER_FACE = 16.0
"""Points on a surface as large as a voxel's face."""

MOST_PATHS_PER_POINT = 4
"""Paths that each of them sends out."""

PATHS_PER_LEVEL = 1 << 21
"""Where there are more points than this, each sends out one path: voxels average many."""


def exact_light(
    prepared: PreparedScene, opacity: OpacityClipmap, scattering_count: int
) -> EmittanceClipmap:
    """Return opacity times mean outgoing radiance for the slots of every clip level.

    Parameters
    ----------
    prepared
        The scene.
    opacity
        Of its voxels, at each clip level's own resolution.
    scattering_count
        Most scatterings between emitter and voxel, >= 1. Emission is left out.
    """
    layout = opacity.layout
    levels = [
        _exact_level(prepared, opacity, each, scattering_count) for each in layout.clip_levels
    ]
    levels += [
        dr.zeros(mi.Color3f, DIRECTION_COUNT * each.voxel_count)
        for each in layout.levels[layout.clip_level_count :]
    ]
    return EmittanceClipmap(layout, levels, [0.0] * layout.clip_level_count)


def _exact_level(
    prepared: PreparedScene, opacity: OpacityClipmap, level: LevelLayout, scattering_count: int
) -> mi.Color3f:
    alpha = opacity.levels[level.level]
    emitted = dr.zeros(mi.Color3f, dr.width(alpha))
    index = mi.UInt32(dr.compress(alpha > 0.0))
    points, normals, areas = sample_surfaces(prepared.surfaces.vertices, level, POINTS_PER_FACE)
    if dr.width(index) == 0 or len(points) == 0:
        return emitted
    samples = _shining_points(prepared.scene, points, normals, areas, level, scattering_count)
    sums = borrow(sum_in_slots(samples, index, level, opacity.rule), index, level)
    is_known = sums.covered > 0.0
    mean = sums.reflected / as_component(dr.select(is_known, sums.covered, 1.0))
    radiance = dr.select(is_known, mean, 0.0)
    dr.scatter(emitted, radiance * as_component(dr.gather(mi.Float, alpha, index)), index)
    dr.eval(emitted)
    return emitted


def _shining_points(
    scene: mi.Scene,
    points: np.ndarray,
    normals: np.ndarray,
    areas: np.ndarray,
    level: LevelLayout,
    scattering_count: int,
) -> SurfaceSamples:
    """Points whose `reflected` is area times the radiance along the normal.

    Radiance has the share of a masked surface that is there in it already.
    """
    position = mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32))
    normal = mi.Vector3f(np.ascontiguousarray(normals.T, dtype=np.float32))
    area = mi.Float(np.ascontiguousarray(areas, dtype=np.float32))
    lift = LIFT_VOXELS * level.voxel_size
    ray = mi.Ray3f(mi.Point3f(dr.fma(normal, lift, position)), -normal)
    near = mi.Ray3f(ray)
    near.maxt = as_component(4.0 * lift)
    si = scene.ray_intersect(near, as_mask(True))
    is_found = mi.Bool(si.is_valid())
    opaque = 1.0 - mi.Float(dr.mean(mi.Color3f(si.bsdf().eval_null_transmission(si))))
    radiance = dr.zeros(mi.Color3f, len(points))
    path_count = min(MOST_PATHS_PER_POINT, max(1, PATHS_PER_LEVEL // len(points)))
    for number in range(path_count):
        radiance += scattered_radiance(scene, ray, scattering_count, number, is_found)
        dr.eval(radiance)
    samples = SurfaceSamples(
        position=position,
        normal=normal,
        area=dr.select(is_found, area * opaque, 0.0),
        reflected=mi.Color3f(radiance * as_component(area / path_count)),
    )
    dr.eval(samples)
    return samples
