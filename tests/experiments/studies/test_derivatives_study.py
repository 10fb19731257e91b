"""Study "derivatives": its list of checks, and how it moves and compares."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.check import StudyContext
from experiments.studies.derivatives import agreement
from experiments.studies.derivatives.measure import (
    by_differences,
    by_forward_mode,
    by_reverse_mode,
    disagreement,
    moved,
)
from experiments.studies.derivatives.slopes import MOST_SEEDS, SEEDS, Place, Way
from reports.study_figures import TableFigure

pytestmark = pytest.mark.usefixtures("variant")


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("derivatives"))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


@pytest.mark.parametrize("start", [[2.0], [0.5, 1.0, 4.0]])
def test_all_three_ways_are_the_derivative_by_the_share(start: list[float]) -> None:
    """Of the mean of (sum of x)^2 and 0 by the share s at which each x becomes x (1 + s w)."""
    values = mi.Float(start)

    def picture(x: mi.Float) -> mi.Float:
        return mi.Float(dr.square(dr.sum(x)) * mi.Float(1.0, 0.0))

    step = 1e-3
    total = float(np.sum(start))
    slope = float(np.sum(np.array(moved(values, 1.0)) - np.array(start)))
    wanted = total * slope
    for found in (by_forward_mode(picture, values), by_reverse_mode(picture, values)):
        assert found == pytest.approx(wanted, rel=1e-6)
    # The square's differences are exact but for rounding over the step
    assert by_differences(picture, values, step) == pytest.approx(wanted, rel=1e-3)


def test_the_derivative_at_a_share_is_by_the_same_share() -> None:
    """Of the mean of (sum of x)^2 again, a third of the way on."""
    values = mi.Float([0.5, 1.0, 4.0])
    found = by_reverse_mode(lambda x: mi.Float(dr.square(dr.sum(x))), values, 1.0 / 3.0)
    held = np.array(values, dtype=np.float64)
    slope = float(np.sum(np.array(moved(values, 1.0)) - held))
    assert found == pytest.approx(2.0 * (held.sum() + slope / 3.0) * slope, rel=1e-6)


def test_a_derivative_that_hardly_counts_is_compared_to_the_mean() -> None:
    one = np.ones(1)
    assert disagreement(1.1 * one, one, one).value == pytest.approx(0.1)
    assert disagreement(0.001 * one, 0.0 * one, one).value == pytest.approx(0.05)


def test_seeds_that_differ_give_a_disagreement_its_interval() -> None:
    found = disagreement(np.array([1.0, 1.4]), np.ones(2), np.ones(2))
    assert found.value == pytest.approx(0.2)
    # Student's t with one degree of freedom, times the standard error of two values.
    assert found.high == pytest.approx(0.2 + 12.7062 * 0.2, rel=1e-4)
    assert found.low == 0.0


@pytest.mark.parametrize(("spread", "count"), [(0.0, 4), (0.07, 16), (0.5, MOST_SEEDS)])
def test_seeds_are_added_until_the_interval_leaves_the_limit(
    monkeypatch: pytest.MonkeyPatch, spread: float, count: int
) -> None:
    """Off by 0.1 at most 0.15, give or take a spread of the seeds."""
    asked: list[int] = []

    def slopes(_context: object, _place: object, way: str, number: int) -> np.ndarray:
        asked.append(number)
        sign = np.where(np.arange(number) % 2 == 0, 1.0, -1.0)
        return 1.1 + spread * sign if way == "reverse" else np.ones(number)

    monkeypatch.setattr(agreement, "slopes", slopes)
    monkeypatch.setattr(agreement, "tabulate", lambda *_: None)
    context = StudyContext(quick=False, progress=lambda _step, _share: None)
    found = agreement._off(context, Place("step_ratio"), "reverse", "coarse")
    assert max(asked) == count
    assert found.value == pytest.approx(0.1)
    assert found.note == f"times 1, {count} seeds"


def test_columns_of_the_table_are_of_the_same_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many seeds a comparison needs: each seed's derivative is its number plus one."""

    def slope(_context: object, _place: object, way: str, seed: int) -> float:
        return 1.0 if way == "mean" else 1.0 + seed

    monkeypatch.setattr("experiments.studies.derivatives.slopes._slope", slope)
    context = StudyContext(quick=False, progress=lambda _step, _share: None)
    pairs: list[tuple[Way, Way]] = [
        ("forward", "fine"),
        ("reverse", "fine"),
        ("reverse", "coarse"),
    ]
    for mode, step in pairs:
        agreement._off(context, Place("step_ratio"), mode, step)
    (table,) = context.shelf.figures
    assert isinstance(table, TableFigure)
    (line,) = table.lines
    found = [cell for cell in line.cells if cell is not None]
    assert {cell.value for cell in found} == {1.0 + 0.5 * (SEEDS[0] - 1)}
    assert len(found) == 4
