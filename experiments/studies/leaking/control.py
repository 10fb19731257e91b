"""A control: the audit of a closed box of radiance 1, in which nothing can leak."""

from __future__ import annotations

from functools import partial

import drjit as dr
import mitsuba as mi

from experiments.studies import scenes
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.closed_forms import FURNACE_SCENE, PLACEMENTS
from experiments.studies.exact_voxels import lay_out_window, light_exactly, scene_of
from experiments.studies.leaking.audit import audit_of, audit_points
from experiments.studies.leaking.pictures import BATCHES, measured
from experiments.studies.tracers import constant_radiance
from metrics.leaking import LeakAudit, audit_shares
from vctgi.config import preset
from vctgi.scene.receivers import white_receivers

RECEIVERS_PER_EDGE = (8, 4)
"""Along an edge of a face, in the whole study and in the quick one."""

MOST = 0.02
"""Largest share that may count as leaked or missing: points are not all equally dark."""

ROWS = ("leak_through", "leak", "missing_light")


def checks() -> list[Check]:
    """Return the checks of the control."""
    return [
        Check(
            name=f"control, white furnace, {placement}, audit, {row}",
            configuration='cones of preset "high", exact light, N = 64',
            scene=FURNACE_SCENE,
            measure=partial(_share, placement=placement, row=row),
            limit_high=MOST,
            goal=0.0,
        )
        for placement in PLACEMENTS
        for row in ROWS
    ]


def audit_furnace(edge: int, batch_count: int, *, is_turned: bool) -> LeakAudit:
    """Return the audit of receivers on the faces of a closed box."""
    scene = scenes.white_furnace(edge, seed=1)
    scene = scene.turned() if is_turned else scene
    world = scene_of(scene.triangles)
    volume = light_exactly(
        world, lay_out_window(scene.triangles), constant_radiance(scene.radiance)
    )
    points = white_receivers(scene.points, scene.normals)
    cones = preset("high").diffuse
    batches = [
        audit_points(world, volume, points, cones, _one, seed) for seed in range(batch_count)
    ]
    return audit_of(batches, (1, len(scene.points)))


def _one(si: mi.SurfaceInteraction3f, lane: mi.UInt32, seed: int) -> mi.Color3f:
    """Radiance 1 of every surface."""
    return mi.Color3f(dr.select(si.is_valid(), mi.Float(1.0), 0.0))


def _share(context: StudyContext, placement: str, row: str) -> Measured:
    audit = context.once(
        f"furnace, {placement}",
        partial(
            audit_furnace,
            RECEIVERS_PER_EDGE[context.quick],
            BATCHES[context.quick],
            is_turned=PLACEMENTS[placement],
        ),
    )
    return measured(audit_shares(audit)[row])
