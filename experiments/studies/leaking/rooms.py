"""L1: light in a sealed dark room beside a lit one, over the radiance of the lit one's walls.

The truth is 0, so no reference is needed. Walls of several thicknesses, along the lattice and
across it, and in each level of a clipmap.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from experiments.studies import closed_forms
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.closed_forms import LEAK_SCENE, PLACEMENTS
from experiments.studies.figures import Curve, Point
from experiments.studies.tracers import Bench, LayOut
from metrics.confidence import estimate_from_leave_one_out
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.config import preset

THICKNESSES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Of the wall, in voxels of the level that holds it."""

QUICK_THICKNESSES = (0.25, 2.0)

MOST = {
    "axis": dict(zip(THICKNESSES, (0.05, 0.05, 0.04, 0.02, 0.018, 0.016), strict=True)),
    "turned": dict(zip(THICKNESSES, (0.12, 0.09, 0.08, 0.06, 0.045, 0.03), strict=True)),
}
"""Most light in the dark room for each placement and thickness; from a quarter voxel on, what the
study "accuracy" asks of the same cones."""

LEVELS = (0, 1, 2)
LEVEL_THICKNESSES = (0.5, 2.0)
LEVEL_RESOLUTION = 64
VOXELS_PER_ROOM = 8
"""Voxels along an edge of a room in the rows on levels: few enough that the rooms fit between the
window of the next finer level and where their own fades out."""

VIEWER_VOXELS = 21.5
"""Distance of the viewer from the rooms there, in voxels of the level that holds them."""

RIM_VIEWER_VOXELS = 26.0
"""The same in the row on the rim of the clipmap: two voxels lie between it and the rooms. Mips that
wide cones read there are interpolated with nothing in their outer half voxel, which thins out the
walls: one of two voxels leaks 0.023, 0.011 if reads are clamped to the middles of the outermost
voxels, and 0.007 far from the rim (two phases)."""

CONES = preset("high").diffuse
NAME = "17 cones"
WORDS = 'cones of preset "high", exact light'

# A quick study has all phases, too: thin walls leak ten times as much at one as at another.
BENCH = Bench(name="leaking", tracers={NAME: CONES}, phases=(8, 8))


def lay_out_level(_triangles: np.ndarray, level: int) -> ClipmapLayout:
    """Return a clipmap of which this level, the coarsest one but one, holds rooms at the origin."""
    return _around_viewer(VIEWER_VOXELS, level, level + 2)


def lay_out_one(_triangles: np.ndarray) -> ClipmapLayout:
    """Return a single level whose rim is far from rooms at the origin."""
    return _around_viewer(VIEWER_VOXELS, 0, 1)


def lay_out_rim(_triangles: np.ndarray) -> ClipmapLayout:
    """Return a single level whose rim is close to rooms at the origin."""
    return _around_viewer(RIM_VIEWER_VOXELS, 0, 1)


def _around_viewer(distance_voxels: float, level: int, level_count: int) -> ClipmapLayout:
    voxel_size = 1.0 / VOXELS_PER_ROOM
    return lay_out_clipmap(
        (0.0, distance_voxels * voxel_size, 0.0),
        finest_voxel_size=voxel_size / 2**level,
        level_count=level_count,
        resolution=LEVEL_RESOLUTION,
    )


def _level_bench(name: str, lay_out: LayOut) -> Bench:
    return Bench(name=f"leaking, {name}", tracers={NAME: CONES}, lay_out=lay_out, phases=(4, 2))


LEVEL_BENCHES = {
    **{
        f"in level {level}": (_level_bench(f"{level}", partial(lay_out_level, level=level)), level)
        for level in LEVELS
    },
    "in the only level": (_level_bench("one", lay_out_one), 0),
    "at the rim of the only level": (_level_bench("rim", lay_out_rim), 0),
}
"""Where the rooms lie, and in which level."""


BY_PLACEMENT = Curve(
    group="A sealed dark room beside a lit one",
    title="Light in the dark room by the wall's thickness and orientation",
    caption="Mean over eight places in the lattice, 95 % interval; the truth is 0 (L1).",
    x_label="thickness of the wall, voxels",
    y_label="light over that of the lit room",
    is_x_log=True,
    is_y_log=True,
)
BY_LEVEL = replace(
    BY_PLACEMENT,
    title="Light in the dark room by the level that holds the wall",
    caption="The same in levels of a clipmap, and beside its rim, where mips read emptiness.",
    x_label="thickness of the wall, voxels of the level",
)
WAYS = {"axis": "along the lattice", "turned": "turned"}


def checks() -> list[Check]:
    """Return the checks of sealed rooms."""
    found = [
        Check(
            name=f"sealed room, wall of {thickness:g} voxels, {placement}",
            configuration=f"{WORDS}, N = 64",
            scene=LEAK_SCENE,
            measure=partial(_ratio, thickness=thickness, placement=placement),
            limit_high=MOST[placement][thickness],
            goal=0.0,
            in_quick=thickness in QUICK_THICKNESSES,
            points=(Point(BY_PLACEMENT, f"walls {WAYS[placement]}", thickness),),
        )
        for placement in PLACEMENTS
        for thickness in THICKNESSES
    ]
    found += [
        Check(
            name=f"sealed room, wall of {QUICK_THICKNESSES[0]:g} over {QUICK_THICKNESSES[1]:g} "
            f"voxels, {placement}",
            configuration=f"{WORDS}; thin walls leak more",
            scene=LEAK_SCENE,
            measure=partial(_growth, placement=placement),
            limit_low=1.0,
        )
        for placement in PLACEMENTS
    ]
    found += [
        Check(
            name=f"sealed room {place}, wall of {thickness:g} voxels",
            configuration=f"{WORDS}, levels of {LEVEL_RESOLUTION}^3, "
            f"{VOXELS_PER_ROOM} voxels to a room",
            scene=LEAK_SCENE,
            measure=partial(_in_level, place=place, thickness=thickness),
            goal=0.0,
            in_quick=False,
            points=(Point(BY_LEVEL, place, thickness),),
        )
        for place in LEVEL_BENCHES
        for thickness in LEVEL_THICKNESSES
    ]
    return found


def ratios(context: StudyContext, thickness: float, placement: str) -> list[float]:
    """Return the ratio at each phase of the lattice."""
    return closed_forms.leak(context, BENCH, thickness, placement)[NAME]


def _ratio(context: StudyContext, thickness: float, placement: str) -> Measured:
    return mean_of(ratios(context, thickness, placement))


def _growth(context: StudyContext, placement: str) -> Measured:
    """Ratio of the means, with the jackknife's interval over phases."""
    thin, thick = (np.array(ratios(context, each, placement)) for each in QUICK_THICKNESSES)
    without = (thin.sum() - thin) / (thick.sum() - thick)
    found = estimate_from_leave_one_out(float(thin.sum() / thick.sum()), without)
    return Measured(value=found.value, low=found.low, high=found.high)


def _in_level(context: StudyContext, place: str, thickness: float) -> Measured:
    bench, level = LEVEL_BENCHES[place]
    # The bench counts in voxels of the finest level.
    return mean_of(closed_forms.leak(context, bench, thickness * 2**level, "axis")[NAME])
