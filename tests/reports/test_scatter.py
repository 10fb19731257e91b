"""Charts of points: complete, escaped, readable by pointer and keyboard; summary, snapshot."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from reports.pdf import PdfMissingError, write_pdf
from reports.publish import main, publish
from reports.scatter_plot import point_text, scatter_file, scatter_svg
from reports.study_figures import (
    Bounded,
    ScatterFigure,
    ScatterPanel,
    ScatterPoint,
    TableFigure,
    TableLine,
)
from reports.study_markdown import MOST_LINES, MOST_ROWS, study_summary, write_summary
from reports.study_page import study_files, study_page, write_study_page
from tests.reports import study_records as synthetic
from tests.reports.chromium import content_width, needs_chromium, opened, probed

AWKWARD = "rooms <b>& \"doors\"</b> 'x' {{ 7*7 }} </script>"


def point(name: str, x: float, error: float, **more: Any) -> ScatterPoint:
    return ScatterPoint(
        name=name,
        family=more.pop("family", "cones"),
        x=Bounded(value=x, low=0.9 * x, high=1.1 * x),
        y=more.pop("y", Bounded(value=error, low=0.8 * error, high=1.3 * error)),
        is_front=more.pop("is_front", False),
    )


def scatter(**changes: Any) -> ScatterFigure:
    points = [
        point("medium", 2.0, 0.3, is_front=True),
        point("high", 5.0, 0.1, is_front=True),
        point(AWKWARD, 9.0, 0.4, family="recipes"),
        *(point(f"paths, {n} spp", 1.0 * n, 4.0 / n, family="paths") for n in (1, 4, 16)),
        point("hidden", 64.0, 0.0, family="paths",
              y=Bounded(value=-0.01, low=-0.05, high=0.03)),
    ]  # fmt: skip
    fields: dict[str, Any] = {
        "group": "box",
        "title": "Error against time",
        "x_label": "time, ms",
        "panels": [ScatterPanel(y_label=label, points=points) for label in ("relMSE", "FLIP")],
        "joined": ["paths"],
    }
    return ScatterFigure(**fields | changes)


@pytest.fixture
def page(tmp_path: Path) -> Path:
    synthetic.written(tmp_path, "pareto", study="pareto", figures=[scatter()])
    return write_study_page(tmp_path)


def test_every_point_can_be_read_and_names_are_escaped() -> None:
    figure = scatter()
    text = scatter_svg(figure, key="chart")
    root = ElementTree.fromstring(text.replace("<svg ", '<svg xmlns:x="x" ', 1))
    groups = [each for each in root.iter() if "data-point" in each.attrib]
    assert len(groups) == sum(len(panel.points) for panel in figure.panels)
    read = {each.attrib["data-point"] for each in groups}
    assert read == {
        point_text(p, figure.x_label, panel.y_label)
        for panel in figure.panels
        for p in panel.points
    }
    assert "<b>&" not in text
    assert scatter_svg(figure, key="chart") == text


def test_a_point_says_its_numbers_and_whether_it_is_on_the_front() -> None:
    words = point_text(scatter().panels[0].points[1], "time, ms", "relMSE")
    assert words == (
        "high (cones; on the front): relMSE 0.1000 [0.0800 to 0.1300], "
        "time, ms 5.000 [4.500 to 5.500]"
    )


def test_a_point_that_noise_hides_is_drawn_at_the_end_of_its_interval() -> None:
    hidden = [point("hidden", 3.0, 0.0, y=Bounded(value=-0.2, low=-0.4, high=-0.1))]
    seen = [point("seen", 2.0, 0.5)]
    figure = scatter(panels=[ScatterPanel(y_label="e", points=seen + hidden)], joined=[])
    assert scatter_svg(figure, key="k").count("data-point") == 1


@pytest.mark.parametrize(("x", "y", "words"), [(0.0, 1.0, "x <= 0"), (1.0, -1.0, "y > 0")])
def test_what_has_no_place_on_the_axes_is_refused(x: float, y: float, words: str) -> None:
    bare = ScatterPoint(
        name="p", family="f", x=Bounded(value=x), y=Bounded(value=y), is_front=False
    )
    with pytest.raises(ValueError, match=words):
        scatter(panels=[ScatterPanel(y_label="e", points=[bare])])


def test_a_chart_of_its_own_is_a_whole_svg_file() -> None:
    text = scatter_file(scatter())
    assert ElementTree.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"
    assert "xlink:" not in text


def test_the_page_loads_nothing_and_says_notes(tmp_path: Path) -> None:
    rows = [synthetic.row("ratio", 2.0, note="at least: <not> reached")]
    path = synthetic.written(
        tmp_path, "pareto", study="pareto", rows=rows, figures=[scatter()], headlines=["ratio"]
    )
    text = study_page([path])
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    assert text.count("at least: &lt;not&gt; reached") == 2
    assert text.count("</script>") == 1


@needs_chromium
def test_points_are_read_by_pointer_and_keyboard_and_families_are_hidden(
    page: Path, tmp_path: Path
) -> None:
    document, console = opened(page, tmp_path / "profile")
    assert console == ""
    assert "data-point" in document
    script = """
      const figure = document.querySelector("figure.scatter");
      const readout = figure.querySelector(".readout");
      const points = [...figure.querySelectorAll("[data-point]")];
      const stops = () => points.filter((each) => each.getAttribute("tabindex") === "0").length;
      const found = [stops()];
      points[1].dispatchEvent(new PointerEvent("pointerenter"));
      found.push(readout.textContent.startsWith("high (cones"));
      points[1].dispatchEvent(new PointerEvent("pointerleave"));
      found.push(readout.textContent.startsWith("Point at a mark"));
      points[0].focus();
      found.push(readout.textContent.startsWith("medium"));
      const down = new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true });
      points[0].dispatchEvent(down);
      found.push(document.activeElement === points[1], stops());
      const box = figure.querySelector(".families input");
      box.click();
      found.push(getComputedStyle(points[0]).display, getComputedStyle(points[3]).display);
      found.push(document.activeElement !== points[1], stops());
      return found;
    """
    found = probed(page, tmp_path / "profile", script)
    assert found == [1, True, True, True, True, 1, "none", "inline", True, 1]


@needs_chromium
@pytest.mark.parametrize("width", [400, 1200])
def test_no_chart_is_wider_than_the_window(page: Path, tmp_path: Path, width: int) -> None:
    assert content_width(page, tmp_path / "profile", width) == width


def test_the_summary_names_failures_first_and_stays_short(tmp_path: Path) -> None:
    names = [f"row {number}" for number in range(3 * MOST_ROWS)]
    rows = [
        *(synthetic.row(name, 0.5, 1.0) for name in names),
        synthetic.row(AWKWARD, 2.0, 1.0),
        synthetic.row("hidden", None, refused="too | noisy"),
    ]
    path = synthetic.written(tmp_path, rows=rows, headlines=names, figures=[])
    text = study_summary([path])
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    assert len(lines) == 2 + MOST_ROWS
    assert "**failed**" in lines[2]
    assert r"refused: too \| noisy" in lines[3]
    assert "<b>" not in text
    assert f"{2 * MOST_ROWS + 2} more are on the page" in text


def test_the_summary_shows_the_first_chart_of_each_group(tmp_path: Path) -> None:
    figures = [scatter(), scatter(title="Moving"), scatter(group="hall")]
    synthetic.written(tmp_path, "pareto", study="pareto", figures=figures)
    synthetic.written(tmp_path, "pareto-gpu", study="pareto", figures=figures)
    text = write_summary(study_files(tmp_path), tmp_path).read_text(encoding="utf-8")
    shown = re.findall(r"!\[[^\]]*\]\(([^)]*)\)", text)
    first, other = (figure.key for figure in (figures[0], figures[2]))
    prefixed = [f"pareto-gpu-{name}.svg" for name in (first, other)]
    assert shown == [*prefixed, f"{first}.svg", f"{other}.svg"]
    assert all((tmp_path / name).read_text().startswith("<svg") for name in shown)


def test_a_long_table_is_cut_in_the_summary_and_folded_on_the_page(tmp_path: Path) -> None:
    lines = [TableLine(name=f"method {n}", cells=[Bounded(value=1.0)]) for n in range(40)]
    table = TableFigure(
        group="box", title="All methods", line_label="method", columns=["time"], lines=lines
    )
    path = synthetic.written(tmp_path, "pareto", study="pareto", figures=[table])
    text = study_summary([path])
    assert sum(line.startswith("| method ") for line in text.splitlines()) == 1 + MOST_LINES
    assert f"{40 - MOST_LINES} more are on the page" in text
    assert "<summary>All methods, 40 lines</summary>" in study_page([path])


def test_a_chart_keeps_its_numbers_and_drops_what_nothing_asks_for() -> None:
    text = scatter_svg(scatter(), key="k")
    named = set(re.findall(r' id="([^"]*)"', text))
    asked = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    assert asked <= named
    assert all(re.match(r"k-(?:point|line|label)-", name) for name in named - asked)
    assert ">0.1</text>" in text
    assert not re.search(r' x="\d+\.\d{3,}"', text)


def test_a_snapshot_holds_pages_that_lead_to_one_another(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    studies, output = tmp_path / "studies", tmp_path / "published"
    write()
    synthetic.written(studies, "pareto", study="pareto", figures=[scatter()])
    output.mkdir()
    (output / "old.html").write_text("of an earlier snapshot")
    names = {path.name for path in publish(tmp_path, studies, output)}
    chart = f"{scatter().key}.svg"
    assert names == {"index.html", "accuracy.html", "summary.md", "sheet.jpg", chart}
    assert 'href="accuracy.html"' in (output / "index.html").read_text()
    assert 'href="index.html"' in (output / "accuracy.html").read_text()
    assert "## Studies" in (output / "summary.md").read_text()


def test_nothing_is_published_without_records(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "published" / "index.html"
    kept.parent.mkdir()
    kept.write_text("kept")
    words = ["--report", tmp_path, "--studies", tmp_path, "--output", kept.parent]
    assert main([str(word) for word in words]) == 2
    assert "no record given" in capsys.readouterr().err
    assert kept.read_text() == "kept"


def test_a_pdf_without_its_extra_is_refused_with_a_remedy(
    page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    with pytest.raises(PdfMissingError, match=r"pip install 'vctgi\[pdf\]'"):
        write_pdf(page)
    assert not page.with_suffix(".pdf").exists()


def test_a_pdf_holds_the_page(page: Path) -> None:
    pytest.importorskip("weasyprint", reason="the extra [pdf] is missing")
    assert write_pdf(page).read_bytes().startswith(b"%PDF")


def test_a_page_that_is_not_there_makes_no_pdf(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such page"):
        write_pdf(tmp_path / "index.html")
