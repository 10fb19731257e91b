"""Figures of studies: kept once, written beside the record, taken up again, put on one page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.errors import EXIT_FAILED
from experiments.studies.catalogue import STUDIES, StudyEntry
from experiments.studies.figures import Curve, FigureShelf, Point, Table, curves_of
from experiments.studies.record_folder import RecordFolder
from reports.image_files import load_image_file
from reports.study_figures import Bounded
from reports.study_record import StudyRow, read_study
from tests.experiments.studies import small_study

MODULE = "tests.experiments.studies.small_study"

CURVE = Curve(group="g", title="t", caption="c", x_label="x", y_label="y")


@pytest.fixture
def folder(variant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder, with the small study offered."""
    monkeypatch.setitem(STUDIES, "small", StudyEntry(MODULE, small_study.TITLE))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str) -> int:
    return main(["study", "small", "--cache", "cache", "--output", "out", *arguments])


def row(check: str, value: float | None) -> StudyRow:
    return StudyRow(
        check=check, configuration="", scene="", value=value, passed=value is not None, how=""
    )


def test_the_first_map_of_a_name_stays(tmp_path: Path) -> None:
    shelf = FigureShelf(tmp_path / "maps")
    shelf.add_map("g", "Light, gathered", np.full((2, 3), 0.25))
    shelf.add_map("g", "Light, gathered", np.zeros((2, 3)))
    (figure,) = shelf.figures
    assert figure.kind == "map"
    assert (figure.low, figure.high) == (0.0, 0.25)
    assert figure.file.path == "maps/g-light-gathered.exr"
    np.testing.assert_array_equal(load_image_file(tmp_path, figure.file, "again"), 0.25)


def test_a_map_of_zeros_has_a_scale(tmp_path: Path) -> None:
    shelf = FigureShelf(tmp_path)
    shelf.add_map("g", "t", np.zeros((2, 3)))
    (figure,) = shelf.figures
    assert figure.kind == "map"
    assert figure.high > figure.low


def test_a_later_run_replaces_the_maps_of_an_earlier_one(tmp_path: Path) -> None:
    for value in (1.0, 2.0):
        shelf = FigureShelf(tmp_path / "maps")
        shelf.add_map("g", "t", np.full((2, 2), value))
    (figure,) = shelf.figures
    assert figure.kind == "map"
    assert load_image_file(tmp_path, figure.file, "again").max() == 2.0


def test_without_a_folder_pictures_are_left_out() -> None:
    shelf = FigureShelf()
    shelf.add_map("g", "map", np.ones((2, 2)))
    shelf.add_picture("g", "picture", np.ones((2, 2, 3)))
    assert shelf.figures == []


def test_cells_fill_the_lines_of_a_table() -> None:
    shelf = FigureShelf()
    table = Table(group="g", title="t", caption="c", line_label="name", columns=("a", "b"))
    shelf.add_cells(table, "first", {"b": Bounded(value=1.0)})
    shelf.add_cells(table, "second", {"a": Bounded(value=2.0)})
    # An earlier run's table, taken up again.
    again = FigureShelf()
    again.add_all(shelf.figures)
    again.add_cells(table, "first", {"a": Bounded(value=3.0), "b": Bounded(value=4.0)})
    (figure,) = again.figures
    assert figure.kind == "table"
    found = {line.name: [cell and cell.value for cell in line.cells] for line in figure.lines}
    assert found == {"first": [3.0, 4.0], "second": [2.0, None]}


def test_rows_make_up_curves_in_the_order_of_their_places() -> None:
    points = {
        "far": (Point(CURVE, "a", 4.0),),
        "near": (Point(CURVE, "a", 1.0), Point(CURVE, "b", 2.0)),
        "nothing": (Point(CURVE, "b", 3.0),),
    }
    rows = [row("far", 0.4), row("near", 0.1), row("nothing", None), row("other", 9.0)]
    (figure,) = curves_of(rows, points)
    assert [(each.name, each.x) for each in figure.series] == [("a", [1.0, 4.0]), ("b", [2.0])]
    assert [each.value for each in figure.series[0].values] == [0.1, 0.4]


def test_a_single_point_is_no_curve() -> None:
    assert curves_of([row("near", 0.1)], {"near": (Point(CURVE, "a", 1.0),)}) == []


def test_the_folder_holds_record_pictures_and_page(folder: Path) -> None:
    assert run() == EXIT_FAILED
    record = read_study(folder / "out" / "small.json")
    assert record.question == small_study.TITLE
    assert [figure.kind for figure in record.figures] == ["curve", "map"]
    assert record.headlines == ["aim"]
    page = (folder / "out" / "index.html").read_text(encoding="utf-8")
    assert small_study.TITLE in page
    assert page.count("<svg") == 1
    assert page.count("data:image/png") == 1


def test_a_resumed_run_keeps_its_figures(folder: Path) -> None:
    run()
    figures = read_study(folder / "out" / "small.json").figures
    small_study.measured.clear()
    run("--resume")
    assert not small_study.measured
    assert read_study(folder / "out" / "small.json").figures == figures


def test_figures_of_another_command_or_code_are_not_kept(folder: Path) -> None:
    run()
    record = read_study(folder / "out" / "small.json")
    kept = RecordFolder(folder / "out", "small", None)
    assert kept.earlier_figures(record.command, record.code) == record.figures
    assert kept.earlier_figures(record.command, "other") == []
    assert kept.earlier_figures("vctgi study small --quick", record.code) == []
    assert RecordFolder(folder / "new", "small", None).earlier_figures("", "") == []


def test_another_scene_has_another_record(folder: Path) -> None:
    run()
    run("--scene", "scenes/My hall/scene.xml")
    names = sorted(path.name for path in (folder / "out").glob("*.json"))
    assert names == ["small-My-hall.json", "small.json"]
    page = (folder / "out" / "index.html").read_text(encoding="utf-8")
    assert page.count('<section class="record"') == 2
