"""Injection: whether light gets into voxels with its power, where it is seen, without stripes."""

from __future__ import annotations

from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.exact_voxels import lay_out_window, surfaces_in
from experiments.studies.light import injection_pictures
from experiments.studies.light.injections import COMPARED, INJECTIONS, Limits, row
from experiments.studies.light.lit_rooms import (
    LitPoints,
    bulb_room,
    lamp,
    light_points,
    nested_layout,
    placement,
    power,
    slot_power,
    small_cube,
)
from experiments.studies.light.visible_flux import leaving_flux, seen_flux
from experiments.studies.phases import phase_offsets
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.emissive import list_emissive_surfaces
from vctgi.stages.voxelization.emittance import voxelize_emission

KEEPS_POWER = ("scatter", "gather", "scatter 3 wide", "gather 3 wide", "scatter 5 wide")
POWER_TOLERANCE = 1e-5
VISIBLE_WITHIN = {"axis": 0.01, "turned": 0.06}
"""Relative; slanted walls are seen through parts that complement each other."""

LARGEST_RIPPLE = 0.01
PHASE_COUNT = 16
CUBE_SIZE, CUBE_VOXELS, LEVELS = 0.2, 3.3, 3
"""Edge of the moved cube, in world units and in voxels of the finest of its levels."""

AWAY = 12
"""Voxels of a level from the middle of its window; the next finer window ends at 8."""

EMITTER_VOXELS = 0.1
ALL_FOUND = 3
"""Width of a pre-filter, for which texels without opacity of their own count as well."""


def checks() -> list[Check]:
    """Return the checks of injection."""
    return [*_power_checks(), *_ripple_checks(), *injection_pictures.checks()]


def _within(tolerance: float) -> Limits:
    return {"limit_low": 1.0 - tolerance, "limit_high": 1.0 + tolerance}


def _power_checks() -> list[Check]:
    rows = []
    for how in INJECTIONS:
        for where, within in VISIBLE_WITHIN.items():
            scene = f"bulb in a closed room, {where}"
            found = partial(_injected, how=how, where=where)
            seen = partial(_visible, how=how, where=where)
            power_limits: Limits = _within(POWER_TOLERANCE) if how in KEEPS_POWER else {}
            seen_limits: Limits = _within(within) if how in KEEPS_POWER else {}
            rows.append(
                row(f"flux found over injected, {where}", how, scene, found, **power_limits)
            )
            quick = how == "scatter"
            rows.append(
                row(
                    f"flux seen over leaving, {where}",
                    how,
                    scene,
                    seen,
                    in_quick=quick,
                    **seen_limits,
                )
            )
    return rows


def _bulb(context: StudyContext, where: str) -> LitPoints:
    def make() -> LitPoints:
        scene = bulb_room(placement(np.zeros(3), is_turned=where == "turned"))
        return light_points(scene, lay_out_window(surfaces_in(scene).vertices))

    return context.once(f"bulb {where}", make)


def _injected(context: StudyContext, how: str, where: str) -> Measured:
    """Flux in the voxels over the flux of texels that find opacity."""
    points = _bulb(context, where)
    lit = points.inject(INJECTIONS[how])
    return Measured(value=power(lit, 0) / slot_power(points, INJECTIONS[how].prefilter))


def _visible(context: StudyContext, how: str, where: str) -> Measured:
    points = _bulb(context, where)
    seen = seen_flux(points.opacity, points.inject(INJECTIONS[how])).sum()
    return Measured(value=float(seen / leaving_flux(points.maps).sum()))


def _ripple_checks() -> list[Check]:
    scene = f"lit cube of {CUBE_VOXELS:g} voxels of level 0, turned, at 16 places"
    rows = []
    for level in range(LEVELS):
        for how in COMPARED:
            limits: Limits = {"limit_high": LARGEST_RIPPLE} if how == "scatter 3 wide" else {}
            found = partial(_ripple, how=how, level=level)
            rows.append(row(f"power ripple, level {level}", how, scene, found, **limits))
    lamp = f"lamp of {EMITTER_VOXELS:g} voxels at 100 places"
    for where in VISIBLE_WITHIN:
        measure = partial(_emitter_ripple, where=where)
        limits = {"limit_high": LARGEST_RIPPLE}
        rows.append(row(f"emitter power ripple, {where}", "analytic", lamp, measure, **limits))
    return rows


def _cubes(context: StudyContext, level: int) -> list[LitPoints]:
    """Return the cube at each place, in voxels of a level and of no finer one."""

    def make() -> list[LitPoints]:
        layout = nested_layout(CUBE_SIZE / CUBE_VOXELS, LEVELS)
        window = layout.levels[level]
        away = np.array([AWAY if level > 0 else 0, 0, 0])
        count = PHASE_COUNT // (4 if context.quick else 1)
        return [
            light_points(
                small_cube(
                    placement((away + phase) * window.voxel_size, is_turned=False), CUBE_SIZE
                ),
                layout,
            )
            for phase in phase_offsets(count)
        ]

    return context.once(f"cubes of level {level}", make)


def _ripple(context: StudyContext, how: str, level: int) -> Measured:
    """Range of the power in the voxels of a level over the flux of the cube's lit points."""
    shares = []
    for points in _cubes(context, level):
        expected = slot_power(points, ALL_FOUND, level)
        shares.append(power(points.inject(INJECTIONS[how]), level) / expected)
    return Measured(value=(max(shares) - min(shares)) / float(np.mean(shares)))


def _emitter_ripple(_context: StudyContext, where: str) -> Measured:
    rng = np.random.default_rng(5)
    layout = nested_layout(0.1, 1)
    shapes = [DIRECTION_COUNT * each.voxel_count for each in layout.levels]
    empty = OpacityClipmap(layout, [dr.zeros(mi.Float, count) for count in shapes])
    found = []
    for _ in range(100):
        outer = placement(rng.uniform(-1.0, 1.0, 3), is_turned=where == "turned")
        scene = lamp(outer, EMITTER_VOXELS * layout.finest_voxel_size)
        _, lit = voxelize_emission(list_emissive_surfaces(scene), empty)
        found.append(power(lit, 0))
    return Measured(value=(max(found) - min(found)) / float(np.mean(found)))
