"""The rows of a column: Cornell box, white furnace, squares and leaks, all with exact light.

Intervals are over phases of the grid.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from experiments.studies import closed_forms
from experiments.studies.accuracy.columns import (
    CLASSIC,
    COLUMNS,
    PYRAMID,
    PYRAMID_WORDS,
    WALL_VOXELS,
    Column,
    Limits,
)
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.closed_forms import (
    FURNACE_SCENE,
    LEAK_SCENE,
    PLACEMENTS,
    SQUARES,
    SQUARES_SCENE,
)
from experiments.studies.cornell_truth import SCENE as CORNELL_SCENE
from experiments.studies.cornell_truth import CornellTruth, scores
from experiments.studies.phases import spread_of
from experiments.studies.tracers import Bench


def checks() -> list[Check]:
    """Return the rows of all columns in a single pyramid of voxels."""
    return [
        check
        for column in (*COLUMNS, CLASSIC)
        for check in rows(column, PYRAMID, column.name, f"{column.words}; {PYRAMID_WORDS}")
    ]


def rows(column: Column, bench: Bench, title: str, words: str) -> list[Check]:
    """Return the rows of a column in the voxels of a bench that it is a tracer of.

    Parameters
    ----------
    column
        Cones and limits.
    bench
        Voxels.
    title
        What the rows' names end with.
    words
        The configuration for the table.
    """
    row = _Rows(column, bench, title, words)
    return [*_cornell(row), *_furnaces(row), *_squares(row), *_leaks(row)]


class _Rows:
    """Makes the checks of one column."""

    def __init__(self, column: Column, bench: Bench, title: str, words: str) -> None:
        self.limits: Limits = column.limits
        self.tracer = column.name
        self.bench = bench
        self._title, self._words = title, words

    def check(
        self,
        name: str,
        scene: str,
        measure: Callable[[StudyContext], Measured],
        within: tuple[float | None, float | None] = (None, None),
        goal: float | None = None,
    ) -> Check:
        """Return one row."""
        return Check(
            name=f"{name}, {self._title}",
            configuration=self._words,
            scene=scene,
            measure=measure,
            limit_low=within[0],
            limit_high=within[1],
            goal=goal,
        )


def _cornell(row: _Rows) -> list[Check]:
    limits = row.limits

    def over_phases(
        summary: Callable[[list[float]], Measured],
        score: Callable[[CornellTruth, np.ndarray], float],
    ) -> Callable[[StudyContext], Measured]:
        return lambda context: summary(scores(context, row.bench, row.tracer, score))

    energy, relmse, mre = CornellTruth.energy, CornellTruth.relmse, CornellTruth.mre
    least, most = limits.phase_energy
    return [
        row.check(f"Cornell box, {name}", CORNELL_SCENE, measure, within, goal)
        for name, measure, within, goal in (
            ("energy ratio", over_phases(mean_of, energy), limits.energy, 1.0),
            ("energy of the darkest phase", over_phases(_least, energy), (least, None), 1.0),
            ("energy of the brightest phase", over_phases(_most, energy), (None, most), 1.0),
            ("energy spread over phases", over_phases(spread_of, energy), (None, limits.spread), 0),
            ("relMSE", over_phases(mean_of, relmse), (None, limits.relmse), limits.relmse_goal),
            ("mean relative error", over_phases(mean_of, mre), (None, limits.mre), 0.0),
        )
    ]


def _least(values: list[float]) -> Measured:
    return Measured(value=min(values))


def _most(values: list[float]) -> Measured:
    return Measured(value=max(values))


def _furnaces(row: _Rows) -> list[Check]:
    limits = row.limits
    least, most = limits.furnace_points
    found = []
    for placement in PLACEMENTS:
        for name, summary, within, goal in (
            ("mean", _mean_of_means, (limits.furnace, most), limits.furnace_goal),
            ("darkest point", _least_point, (least, None), 1.0),
            ("brightest point", _most_point, (None, most), 1.0),
        ):
            measure = partial(_furnace, row=row, placement=placement, summary=summary)
            title = f"white furnace, {placement}, {name}"
            found.append(row.check(title, FURNACE_SCENE, measure, within, goal))
    return found


def _furnace(
    context: StudyContext,
    row: _Rows,
    placement: str,
    summary: Callable[[list[np.ndarray]], Measured],
) -> Measured:
    return summary(closed_forms.furnace(context, row.bench, placement)[row.tracer])


def _mean_of_means(found: list[np.ndarray]) -> Measured:
    return mean_of([float(each.mean()) for each in found])


def _least_point(found: list[np.ndarray]) -> Measured:
    return Measured(value=min(float(each.min()) for each in found))


def _most_point(found: list[np.ndarray]) -> Measured:
    return Measured(value=max(float(each.max()) for each in found))


def _squares(row: _Rows) -> list[Check]:
    off = row.limits.squares
    within = (None, None) if off is None else (1.0 - off, 1.0 + off)
    return [
        row.check(
            f"squares, {case}, {placement}",
            SQUARES_SCENE,
            partial(_square, row=row, case=case, placement=placement),
            within,
            1.0,
        )
        for placement in PLACEMENTS
        for case in SQUARES
    ]


def _square(context: StudyContext, row: _Rows, case: str, placement: str) -> Measured:
    return mean_of(closed_forms.squares(context, row.bench, case, placement)[row.tracer])


def _leaks(row: _Rows) -> list[Check]:
    most = row.limits.leaks
    return [
        row.check(
            f"leak, wall of {thickness:g} voxels, {placement}",
            LEAK_SCENE,
            partial(_leak, row=row, thickness=thickness, placement=placement),
            (None, None if most is None else most[placement][thickness]),
            0.0,
        )
        for placement in PLACEMENTS
        for thickness in WALL_VOXELS
    ]


def _leak(context: StudyContext, row: _Rows, thickness: float, placement: str) -> Measured:
    return mean_of(closed_forms.leak(context, row.bench, thickness, placement)[row.tracer])
