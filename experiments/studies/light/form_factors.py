"""Form factors: light between two unit squares by the renderer's cones, and by thin rays."""

from __future__ import annotations

from functools import partial

import numpy as np

import vctgi
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.closed_forms import (
    FORM_FACTORS,
    PLACEMENTS,
    SQUARE_EDGE,
    SQUARES,
)
from experiments.studies.exact_voxels import lay_out_window, light_exactly, scene_of
from experiments.studies.phases import phase_offsets
from experiments.studies.representation.thin_rays import RAYS
from experiments.studies.tracers import constant_radiance
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, trace_diffuse

CONES: dict[str, DiffuseConesConfig] = {
    "default march": vctgi.preset("high").diffuse,
    "thin rays": RAYS,
}
"""What gathers the light."""

WITHIN = {"default march": 0.20, "thin rays": 0.08}
"""Relative error that the mean over points and phases may have."""

PHASE_COUNT = (8, 2)
"""Phases of the grid, in the whole study and in the quick one."""


def checks() -> list[Check]:
    """Return the checks of form factors."""
    return [
        Check(
            name=f"form factor, {case}, {placement}, {march}",
            configuration=f"{CONES[march].cone_count} cones, near field of "
            f"{CONES[march].near_field_voxels:g} voxels, N = 64, exact light",
            scene="two unit squares, mean irradiance over closed form",
            measure=partial(_ratio, case=case, placement=placement, march=march),
            limit_low=1.0 - WITHIN[march],
            limit_high=1.0 + WITHIN[march],
            goal=1.0,
        )
        for march in CONES
        for case in SQUARES
        for placement in PLACEMENTS
    ]


def _ratio(context: StudyContext, case: str, placement: str, march: str) -> Measured:
    shape = SQUARES[case](SQUARE_EDGE[context.quick], 2)
    shape = shape.turned() if PLACEMENTS[placement] else shape
    layout = lay_out_window(shape.triangles)
    ratios = []
    for offset in phase_offsets(PHASE_COUNT[context.quick]):
        moved = shape.moved(offset * layout.finest_voxel_size)
        world = scene_of(moved.triangles)
        volume = light_exactly(world, layout, constant_radiance(moved.radiance))
        points = white_receivers(moved.points, moved.normals)
        found = np.array(trace_diffuse(points, volume, CONES[march], world))[0]
        ratios.append(float(found.mean()) / FORM_FACTORS[case])
    return mean_of(ratios)
