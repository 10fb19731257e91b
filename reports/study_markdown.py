"""Records of studies -> Markdown for a pull request: what failed, what is read first, tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from reports.headline import number
from reports.markdown import MARKUP
from reports.scatter_plot import scatter_file
from reports.study_figures import Bounded, ScatterFigure, TableFigure
from reports.study_record import StudyRecord, StudyRow, read_study

MOST_ROWS = 40
"""Of a study; the page has the others."""

MOST_LINES = 12
"""Of a table, likewise."""

SUMMARY_NAME = "summary.md"


def study_summary(paths: Sequence[Path]) -> str:
    """Return a table for each study, rows that failed, then its headlines; and its own tables.

    Raises
    ------
    ValueError
        There is no record, or one is broken.
    """
    if not paths:
        raise ValueError(
            "study_summary: no record given; make one with `vctgi study NAME --output`"
        )
    records = [(path, read_study(path)) for path in sorted(paths)]
    return "\n".join(_part(path, record) for path, record in records)


def write_summary(paths: Sequence[Path], folder: Path) -> Path:
    """Write the summary and the charts that it shows beside it; return its path.

    Raises
    ------
    ValueError
        As `study_summary`.
    """
    text = study_summary(paths)
    for name, chart in summary_charts(paths).items():
        (folder / name).write_text(chart, encoding="utf-8")
    (folder / SUMMARY_NAME).write_text(text, encoding="utf-8")
    return folder / SUMMARY_NAME


def summary_charts(paths: Sequence[Path]) -> dict[str, str]:
    """Return the charts that the summary shows, as SVG files by their names."""
    records = [(path, read_study(path)) for path in sorted(paths)]
    return {
        name: scatter_file(figure)
        for path, record in records
        for name, figure in _charts(path, record).items()
    }


def _charts(path: Path, record: StudyRecord) -> dict[str, ScatterFigure]:
    """Return the first chart of points of each group, by the name of its file."""
    found: dict[str, ScatterFigure] = {}
    groups = set()
    # Records of one study that have names of their own may hold charts of one name.
    prefix = "" if path.stem == record.study else f"{path.stem}-"
    for figure in record.figures:
        if isinstance(figure, ScatterFigure) and figure.group not in groups:
            groups.add(figure.group)
            found[f"{prefix}{figure.key}.svg"] = figure
    return found


def _part(path: Path, record: StudyRecord) -> str:
    failed = [row for row in record.rows if not row.passed]
    headlines = [row for row in record.rows if row.passed and row.check in record.headlines]
    listed = [*failed, *headlines]
    machine = record.machine
    lines = [
        f"### {_cell(path.stem)}",
        "",
        _cell(record.question),
        "",
        f"{len(failed)} of {len(record.rows)} numbers did not pass. "
        f"Made by `{record.command}` on {_cell(machine.device)}, commit {machine.commit[:12]}"
        f"{', with uncommitted changes' if machine.is_dirty else ''}"
        f"{'; the quick version' if record.quick else ''}.",
        "",
    ]
    if listed:
        lines += [
            "| number | value (95 % interval) | limit | verdict |",
            "| --- | ---: | ---: | --- |",
        ]
        lines += [_line(row) for row in listed[:MOST_ROWS]]
        if len(listed) > MOST_ROWS:
            lines += ["", f"{len(listed) - MOST_ROWS} more are on the page."]
        lines.append("")
    for name, chart in _charts(path, record).items():
        lines += [f"![{_cell(chart.group)}: {_cell(chart.title)}]({name})", ""]
    for figure in record.figures:
        if isinstance(figure, TableFigure):
            lines += _table(figure)
    return "\n".join(lines)


def _table(figure: TableFigure) -> list[str]:
    caption = f"**{_cell(figure.title)}** {_cell(figure.caption)}".rstrip()
    found = [
        caption,
        "",
        f"| {' | '.join(_cell(each) for each in (figure.line_label, *figure.columns))} |",
        f"| --- |{' ---: |' * len(figure.columns)}",
    ]
    for line in figure.lines[:MOST_LINES]:
        cells = [_cell(line.name), *(_bounded(cell) for cell in line.cells)]
        found.append(f"| {' | '.join(cells)} |")
    if len(figure.lines) > MOST_LINES:
        found += ["", f"{len(figure.lines) - MOST_LINES} more are on the page."]
    return [*found, ""]


def _line(row: StudyRow) -> str:
    note = f", {_cell(row.note)}" if row.note else ""
    verdict = f"refused: {_cell(row.refused)}" if row.refused else _verdict(row)
    return f"| {_cell(row.check)} | {_value(row)}{note} | {_limit(row)} | {verdict} |"


def _verdict(row: StudyRow) -> str:
    if not row.passed:
        return "**failed**"
    return "passed" if row.limit_low is not None or row.limit_high is not None else ""


def _value(row: StudyRow) -> str:
    if row.value is None:
        return "\N{EN DASH}"
    return _bounded(Bounded(value=row.value, low=row.low, high=row.high))


def _bounded(found: Bounded | None) -> str:
    if found is None:
        return "\N{EN DASH}"
    if found.low is None or found.high is None:
        return number(found.value)
    return f"{number(found.value)} ({number(found.low)} to {number(found.high)})"


def _limit(row: StudyRow) -> str:
    if row.limit_low is not None and row.limit_high is not None:
        return f"{number(row.limit_low)} to {number(row.limit_high)}"
    if row.limit_low is not None:
        return f"\N{GREATER-THAN OR EQUAL TO} {number(row.limit_low)}"
    return "" if row.limit_high is None else f"\N{LESS-THAN OR EQUAL TO} {number(row.limit_high)}"


def _cell(text: str) -> str:
    return MARKUP.sub(r"\\\1", " ".join(text.split()))
