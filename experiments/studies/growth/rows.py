"""The rows of the study "growth": an exponent of each cost over each size, and its charts."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.growth.axes import AXES, COSTS, COUNT, DEVICE, MEMORY, Axis, costs_of
from experiments.studies.growth.exponents import Cost, fitted_exponent, last_exponent
from reports.study_figures import Bounded, CurveFigure, Definition, Series

LINEAR: Final = 1.1
"""Largest exponent that counts as linear: n log n has 1 + 1 / ln n, which is 1.1 at 2e4."""

UNITS: Final = {DEVICE: "ms", COUNT: "", MEMORY: "MiB"}
SCALES: Final = {DEVICE: 1e3, COUNT: 1.0, MEMORY: 2.0**-20}

CONFIGURATION: Final = "levels of 32^3 or 64^3, six directions, one ray a pixel, no near field"

DEFINITIONS = (
    Definition(
        name="exponent",
        formula="slope of the logarithm of a cost over that of a size; 1 is linear",
        source="experiments/studies/growth/exponents.py; least squares with Student's t interval",
    ),
    Definition(
        name="at the end",
        formula="the same between the two largest sizes, where a fixed cost hides least",
        source="experiments/studies/growth/exponents.py; interval: the range over repetitions",
    ),
    Definition(
        name="device time",
        formula="run times of kernels, without primary visibility; median of repetitions",
        source="experiments/bench/kernels.py, dr.kernel_history",
    ),
    Definition(
        name="count",
        formula="texels that cones read; for voxels and light, operations of the kernels' code "
        "times lanes, those of loops once",
        source="experiments/bench/reads.py, experiments/bench/kernels.py",
    ),
    Definition(
        name="memory",
        formula="most bytes that Dr.Jit's allocator held beyond those before the work",
        source="experiments/studies/growth/axes.py",
    ),
)


def checks() -> list[Check]:
    """Return the checks of all axes."""
    return [check for axis in AXES for kind in COSTS for check in _checks_of(axis, kind)]


def _checks_of(axis: Axis, kind: str) -> list[Check]:
    what = axis.counted if kind == COUNT else kind
    is_asked = kind == MEMORY or not axis.note
    return [
        Check(
            name=f"{axis.name}: exponent of {what}{place}",
            configuration=CONFIGURATION,
            scene=SCENES[axis.name],
            measure=partial(_measure, axis, kind, is_last),
            limit_high=LINEAR if is_asked else None,
            goal=LINEAR,
            is_headline=is_last and kind == DEVICE,
        )
        for place, is_last in (("", False), (" at the end", True))
    ]


SCENES: Final = {
    "pixels": "cornell_box",
    "cones": "cornell_box",
    "cones of one width": "cornell_box",
    "traced pixels": "cornell_box",
    "levels": "corridor",
    "voxels": "corridor",
    "triangles": "wavy sheets",
    "lights": "cornell_box with point lights",
}
"""What each axis is measured on."""


def _measure(axis: Axis, kind: str, is_last: bool, context: StudyContext) -> Measured:
    costs = costs_of(context, axis)
    for each, values in costs.items():
        context.shelf.add(_chart(axis, each, values))
    found = last_exponent(costs[kind]) if is_last else fitted_exponent(costs[kind])
    return found if kind == MEMORY else replace(found, note=axis.note)


def _chart(axis: Axis, kind: str, costs: list[Cost]) -> CurveFigure:
    unit, scale = UNITS[kind], SCALES[kind]
    what = axis.counted if kind == COUNT else kind
    first = costs[0]
    line = [first.value * each.size / first.size for each in costs]
    sizes = [each.size for each in costs]
    return CurveFigure(
        group=axis.name,
        title=f"{what} over {axis.name}",
        caption="Growth in proportion from the first point on, for comparison.",
        x_label=axis.label,
        y_label=f"{what}, {unit}" if unit else what,
        is_x_log=True,
        is_y_log=True,
        series=[
            Series(
                name="measured",
                x=sizes,
                values=[
                    Bounded(value=scale * each.value, low=scale * each.low, high=scale * each.high)
                    for each in costs
                ],
            ),
            Series(
                name="in proportion", x=sizes, values=[Bounded(value=scale * each) for each in line]
            ),
        ],
    )
