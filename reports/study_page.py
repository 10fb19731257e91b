"""Records of studies -> one self-contained HTML page: what was asked, found, and how."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import groupby
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from reports.headline import number
from reports.image_files import load_image_file
from reports.pictures import colour_stops, sequential_uri, tone_mapped_uri
from reports.scatter_plot import scatter_svg
from reports.study_figures import (
    Bounded,
    Figure,
    MapFigure,
    PictureFigure,
    ScatterFigure,
    TableFigure,
)
from reports.study_plots import curve_svg, waterfall_svg
from reports.study_record import StudyRecord, StudyRow, read_study

STUDY_ORDER = (
    *("pareto", "stability", "elimination", "gates"),
    *("leaking", "aliasing", "banding", "flicker", "attribution"),
)
"""Cost and soundness first, then artefacts and who is to blame; others follow by name."""

MOST_HEADLINES = 8
"""Rows that are read first where a record names none."""

TWO_HUES, ONE_HUE = "RdBu_r", "magma"

PAGE_NAME = "index.html"


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A figure, ready to be set into the page."""

    figure: Figure
    uri: str | None = None
    """Of a map or picture."""
    width: int = 0
    height: int = 0
    colours: str = ""
    """Of the colour scale, from low to high."""
    chart: Markup | None = None
    notes: tuple[str, ...] = ()
    """What a waterfall leaves over, in words."""
    families: tuple[str, ...] = ()
    """Of points, which can be hidden and shown."""


@dataclass(frozen=True, kw_only=True)
class Gallery:
    """Figures of one group."""

    title: str
    pictures: list[Shown]
    charts: list[Shown]
    tables: list[TableFigure]


@dataclass(frozen=True, kw_only=True)
class Block:
    """Rows of one configuration and scene."""

    configuration: str
    scene: str
    rows: list[StudyRow]


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """All that the page shows of one study."""

    key: str
    title: str
    record: StudyRecord
    failed: list[StudyRow]
    """Those that were refused, too."""
    headlines: list[StudyRow]
    galleries: list[Gallery]
    blocks: list[Block]
    """Of the rows that did not fail."""

    @property
    def refused_count(self) -> int:
        """Rows that were not measured."""
        return sum(bool(row.refused) for row in self.failed)

    @property
    def failed_count(self) -> int:
        """Rows that were measured and did not pass."""
        return len(self.failed) - self.refused_count

    @property
    def limited_count(self) -> int:
        """Rows of which something is asked."""
        return sum(has_limit(row) for row in self.record.rows)


def study_page(paths: Sequence[Path], *, accuracy_page: str | None = None) -> str:
    """Build the page; the same records give the same characters.

    Parameters
    ----------
    paths
        Files of records; pictures are read beside them and checked.
    accuracy_page
        Name of the page of accuracy beside this one, if there is one.

    Returns
    -------
    str
        HTML that loads nothing: style, script, pictures and charts are inside.

    Raises
    ------
    ValueError
        There is no record, or one or a picture of one is broken.
    """
    if not paths:
        raise ValueError("study_page: no record given; make one with `vctgi study NAME --output`")
    records = sorted(
        ((path, read_study(path)) for path in paths), key=lambda found: _rank(found[1], found[0])
    )
    chapters = [
        _chapter(f"study-{index}", path, record)
        for index, (path, record) in enumerate(records, start=1)
    ]
    environment = Environment(
        loader=PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number=plain_number, tick=_tick)
    environment.tests.update(limited=has_limit)
    return environment.get_template("studies.html.j2").render(
        chapters=chapters,
        accuracy_page=accuracy_page,
        style=Markup(_part("accuracy.css") + _part("studies.css")),
        script=Markup(_part("accuracy.js") + _part("scatter.js")),
    )


def write_study_page(folder: Path) -> Path:
    """Write the page of all records of studies in a folder; return its path.

    Raises
    ------
    ValueError
        As `study_page`.
    """
    page = study_page(study_files(folder))
    path = folder / PAGE_NAME
    path.write_text(page, encoding="utf-8")
    return path


def study_files(folder: Path) -> list[Path]:
    """Return the files of a folder that say that they are records of studies."""
    return [path for path in sorted(folder.glob("*.json")) if _is_study(path)]


def has_limit(row: StudyRow) -> bool:
    """Whether anything is asked of a row."""
    return row.limit_low is not None or row.limit_high is not None


def plain_number(value: float) -> str:
    """Write a number for a table; a zero is exact, and has no decimals."""
    return "0" if value == 0.0 else number(value)


def _tick(value: float) -> str:
    return f"{value:.3g}".replace("-", "\N{MINUS SIGN}")


def _interval_words(found: Bounded) -> str:
    if found.low is None or found.high is None:
        return plain_number(found.value)
    return f"{plain_number(found.value)} [{plain_number(found.low)} to {plain_number(found.high)}]"


def _is_study(path: Path) -> bool:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError):
        return False
    return isinstance(content, dict) and {"study", "rows"} <= set(content)


def _rank(record: StudyRecord, path: Path) -> tuple[int, str, str]:
    known = record.study in STUDY_ORDER
    place = STUDY_ORDER.index(record.study) if known else len(STUDY_ORDER)
    return place, record.study, path.stem


def _chapter(key: str, path: Path, record: StudyRecord) -> Chapter:
    failed = [row for row in record.rows if not row.passed]
    kept = [row for row in record.rows if row.passed]
    blocks = [
        Block(configuration=words[0], scene=words[1], rows=list(rows))
        for words, rows in groupby(kept, key=lambda row: (row.configuration, row.scene))
    ]
    return Chapter(
        key=key,
        title=path.stem.replace("-", ": ", 1).replace("_", " ").capitalize(),
        record=record,
        failed=failed,
        headlines=_headlines(record),
        galleries=_galleries(key, path.parent, record),
        blocks=blocks,
    )


def _headlines(record: StudyRecord) -> list[StudyRow]:
    """Return the rows that are read first, those that failed before the others."""
    named = [row for row in record.rows if row.check in record.headlines]
    found = named or [row for row in record.rows if has_limit(row)][:MOST_HEADLINES]
    return sorted(found, key=lambda row: row.passed)


def _galleries(key: str, folder: Path, record: StudyRecord) -> list[Gallery]:
    groups: dict[str, list[Shown]] = {}
    for index, figure in enumerate(record.figures, start=1):
        shown = _shown(f"{key}-figure-{index}", folder, figure, record.command)
        groups.setdefault(figure.group, []).append(shown)
    return [
        Gallery(
            title=title,
            # What there is to see comes before what is wrong with it.
            pictures=sorted(
                (each for each in found if each.uri is not None),
                key=lambda each: each.figure.kind != "picture",
            ),
            charts=[each for each in found if each.chart is not None],
            tables=[each.figure for each in found if isinstance(each.figure, TableFigure)],
        )
        for title, found in groups.items()
    ]


def _shown(key: str, folder: Path, figure: Figure, command: str) -> Shown:
    if isinstance(figure, MapFigure | PictureFigure):
        pixels = load_image_file(folder, figure.file, command)
        height, width = pixels.shape[:2]
        if isinstance(figure, PictureFigure):
            uri = tone_mapped_uri(pixels, exposure=figure.exposure)
            return Shown(figure=figure, uri=uri, width=width, height=height)
        colours = TWO_HUES if figure.low == -figure.high else ONE_HUE
        uri = sequential_uri(pixels, low=figure.low, high=figure.high, colours=colours)
        return Shown(
            figure=figure,
            uri=uri,
            width=width,
            height=height,
            colours=", ".join(colour_stops(colours)),
        )
    if isinstance(figure, TableFigure):
        return Shown(figure=figure)
    if figure.kind == "curve":
        return Shown(figure=figure, chart=Markup(curve_svg(figure, key=key)))
    if isinstance(figure, ScatterFigure):
        chart = Markup(scatter_svg(figure, key=key))
        return Shown(figure=figure, chart=chart, families=tuple(figure.families))
    notes = tuple(
        f"{panel.label}: left over with all exact {_interval_words(panel.end)}; "
        f"interaction that no order shares out {plain_number(panel.interaction)}."
        for panel in figure.panels
    )
    return Shown(figure=figure, chart=Markup(waterfall_svg(figure, key=key)), notes=notes)


def _part(name: str) -> str:
    return files("reports").joinpath("templates", name).read_text(encoding="utf-8")
