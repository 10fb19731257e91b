"""The study of eliminations: it covers all of them, and its numbers find a change."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from experiments.studies.check import Measured, StudyContext
from experiments.studies.elimination.figures import Savings
from experiments.studies.elimination.frames import Pair, Rendered, Work, interleaved
from experiments.studies.figures import FigureShelf

pytestmark = pytest.mark.usefixtures("variant")

NAMES = ("indirect_diffuse", "indirect_specular", "albedo", "normal", "depth")


def rendered(value: float, left_out: float = 0.0) -> Rendered:
    pictures = {name: np.full((2, 2, 3), value, dtype=np.float32) for name in NAMES}
    frame = SimpleNamespace(**pictures, ambient=None)
    lit = SimpleNamespace(left_out_radiance=left_out)
    return Rendered(cast("Any", frame), cast("Any", lit))


def comparison(lean: Rendered, kept: Rendered) -> Any:
    from experiments.studies.elimination.comparison import Comparison

    works = Work(100.0, 10, 1.0 * 2**20), Work(150.0, 12, 3.0 * 2**20)
    return Comparison(lean, kept, *works, [1.0, 2.0, 4.0], [3.0, 4.0, 20.0])


def test_every_elimination_has_a_case() -> None:
    from experiments.studies.elimination.cases import CASES
    from vctgi.eliminations import ELIMINATIONS

    assert {case.keep for case in CASES} == set(ELIMINATIONS)


def test_one_changed_number_is_found() -> None:
    same, other = rendered(1.0), rendered(1.0)
    assert comparison(same, rendered(1.0)).difference(None).value == 0.0
    np.asarray(other.frame.albedo)[0, 0, 0] = np.nextafter(np.float32(1.0), np.float32(2.0))
    assert comparison(same, other).difference(None).value == 1.0


def test_a_difference_is_held_against_its_bound() -> None:
    def bound(lean: Rendered, _kept: Rendered) -> float:
        return lean.lit.left_out_radiance

    found = comparison(rendered(1.0, left_out=0.5), rendered(1.25)).difference(bound)
    assert found.value == 0.5
    nothing = comparison(rendered(1.0), rendered(1.25)).difference(bound)
    assert nothing.value == np.inf
    assert comparison(rendered(1.0), rendered(1.0)).difference(bound).value == 0.0


def test_ratios_are_those_of_kept_over_left_out() -> None:
    found = comparison(rendered(1.0), rendered(1.0))
    assert found.time_ratio.value == 3.0
    assert found.least_time_ratio.value == pytest.approx(1.0 / 3.0)
    assert found.operation_ratio.value == 1.5
    assert found.memory_saved.value == 2.0


def test_frames_are_timed_in_turns_of_alternating_order() -> None:
    order: list[str] = []

    def renderer(name: str) -> Any:
        return lambda _seed: order.append(name)

    lean, kept = interleaved(Pair(renderer("lean"), renderer("kept")), 4)
    assert len(lean) == len(kept) == 4
    assert order == ["kept", "lean", "lean", "kept"] * 2


def test_the_chart_holds_every_case_that_was_measured() -> None:
    savings, shelf = Savings(), FigureShelf()
    savings.draw(shelf)
    assert not shelf.figures
    time = comparison(rendered(1.0), rendered(1.0)).time_ratio
    none = Measured(value=0.0)
    savings.note("first", none, time, Work(1.0, 1, 1.0), Work(2.0, 1, 4.0))
    savings.note("second", none, time, Work(1.0, 1, 1.0 * 2**20), Work(1.0, 1, 1.0 * 2**20))
    savings.draw(shelf)
    table, figure = shelf.figures
    assert [line.name for line in table.lines] == ["first", "second"]  # type: ignore[union-attr]
    assert [line.cells[2].value for line in table.lines] == [2.0, 1.0]  # type: ignore[union-attr]
    assert [[p.y.value for p in panel.points] for panel in figure.panels] == [[2, 1], [4, 1]]  # type: ignore[union-attr]


def test_the_scene_that_needs_all_has_nothing_left_out() -> None:
    from experiments.studies.elimination import checks

    context = StudyContext(quick=True, progress=lambda _step, _share: None)
    check = checks()[-1]
    assert "eliminations that apply" in check.name
    assert check.measure(context).value == 0.0
