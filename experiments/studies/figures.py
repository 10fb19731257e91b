"""Figures of a study: kept once whichever checks run, with their pictures beside the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from metrics import auto_exposure
from reports.image_files import write_image
from reports.schema import ImageFile
from reports.study_figures import (
    Bounded,
    CurveFigure,
    Figure,
    MapFigure,
    PictureFigure,
    Series,
    TableFigure,
    TableLine,
    figure_key,
)
from reports.study_record import StudyRow

BRIGHTEST = 0.99
"""Quantile that a colour scale reaches to where nothing else says how far."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A chart whose points are rows of the study."""

    group: str
    title: str
    caption: str
    x_label: str
    y_label: str
    is_x_log: bool = False
    is_y_log: bool = False


@dataclass(frozen=True)
class Point:
    """Where the number of a check stands on a curve."""

    curve: Curve
    series: str
    x: float


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table whose lines are filled as measurements go on."""

    group: str
    title: str
    caption: str
    line_label: str
    columns: tuple[str, ...]


class FigureShelf:
    """The figures of one run.

    Parameters
    ----------
    folder
        Where their pictures are written, made when the first is; None: maps and pictures are left
        out, and other figures are data alone.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._figures: dict[str, Figure] = {}

    @property
    def figures(self) -> list[Figure]:
        """All figures, in the order in which they came."""
        return list(self._figures.values())

    def add(self, figure: Figure) -> None:
        """Keep a figure; the first of a name stays."""
        self._figures.setdefault(figure.key, figure)

    def add_all(self, figures: Sequence[Figure]) -> None:
        """Keep several figures."""
        for figure in figures:
            self.add(figure)

    def add_map(
        self,
        group: str,
        title: str,
        values: np.ndarray,
        *,
        high: float | None = None,
        low: float = 0.0,
        unit: str = "",
        caption: str = "",
    ) -> None:
        """Write a map and keep it, if files are wanted.

        Parameters
        ----------
        group, title, caption, unit
            As `reports.study_figures.MapFigure` has them.
        values
            [row, column].
        low, high
            Ends of the colour scale; high None: the brightest hundredth of the values is beyond it.
        """
        if self._is_known(group, title):
            return
        top = float(np.quantile(values, BRIGHTEST)) if high is None else high
        self.add(
            MapFigure(
                group=group,
                title=title,
                caption=caption,
                file=self._write(group, title, values),
                low=low,
                # A map of zeros has a scale, too.
                high=top if top > low else low + 1.0,
                unit=unit,
            )
        )

    def add_picture(
        self,
        group: str,
        title: str,
        linear: np.ndarray,
        *,
        like: np.ndarray | None = None,
        caption: str = "",
    ) -> None:
        """Write linear radiance [row, column, rgb] and keep it, if files are wanted.

        Parameters
        ----------
        group, title, caption
            As `reports.study_figures.PictureFigure` has them.
        linear
            The picture.
        like
            Picture whose exposure it takes; None: its own.
        """
        if self._is_known(group, title):
            return
        self.add(
            PictureFigure(
                group=group,
                title=title,
                caption=caption,
                file=self._write(group, title, linear),
                exposure=auto_exposure(linear if like is None else like),
            )
        )

    def add_cells(self, table: Table, line: str, cells: Mapping[str, Bounded]) -> None:
        """Put numbers into a line of a table; a number in the same place is replaced.

        Parameters
        ----------
        table
            Which.
        line
            Name of the line, which comes below those that are there.
        cells
            Numbers by the names of their columns.
        """
        key = figure_key(table.group, table.title)
        held = self._figures.get(key)
        lines = {each.name: each for each in held.lines} if isinstance(held, TableFigure) else {}
        known = lines[line].cells if line in lines else [None] * len(table.columns)
        lines[line] = TableLine(
            name=line,
            cells=[cells.get(name, cell) for name, cell in zip(table.columns, known, strict=True)],
        )
        self._figures[key] = TableFigure(
            group=table.group,
            title=table.title,
            caption=table.caption,
            line_label=table.line_label,
            columns=list(table.columns),
            lines=list(lines.values()),
        )

    def _is_known(self, group: str, title: str) -> bool:
        return self._folder is None or figure_key(group, title) in self._figures

    def _write(self, group: str, title: str, values: np.ndarray) -> ImageFile:
        assert self._folder is not None, "only asked for where files are wanted"
        path = self._folder / f"{figure_key(group, title)}.exr"
        # What an earlier run of the study left.
        path.unlink(missing_ok=True)
        return write_image(path, values, f"{group}: {title}")


def curves_of(rows: Sequence[StudyRow], points: dict[str, tuple[Point, ...]]) -> list[CurveFigure]:
    """Return the curves that rows make up; those of a single point are left out.

    Parameters
    ----------
    rows
        Of the study.
    points
        Where each stands, by the name of its check.
    """
    found: dict[Curve, dict[str, dict[float, Bounded]]] = {}
    for row in rows:
        for point in points.get(row.check, ()):
            if row.value is None:
                continue
            line = found.setdefault(point.curve, {}).setdefault(point.series, {})
            line[point.x] = Bounded(value=row.value, low=row.low, high=row.high)
    return [
        CurveFigure(
            **vars(curve),
            series=[
                Series(name=name, x=sorted(line), values=[line[x] for x in sorted(line)])
                for name, line in lines.items()
            ],
        )
        for curve, lines in found.items()
        if len({x for line in lines.values() for x in line}) > 1
    ]
