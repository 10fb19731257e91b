"""A study's rows as lines of text, each complete as soon as its number is known."""

from __future__ import annotations

from reports.study_record import StudyRow

WIDTHS = {"check": 52, "value": 10, "interval": 22, "limits": 18, "goal": 8}
"""Characters of a column; what is longer pushes the rest of its line to the right."""


def head_line() -> str:
    """Return the names of the columns."""
    return _line(*WIDTHS, "")


def row_line(row: StudyRow) -> str:
    """Return one row."""
    interval = "-" if row.low is None else f"[{_number(row.low)}, {_number(row.high)}]"
    return _line(
        row.check,
        _number(row.value),
        interval,
        _limits(row.limit_low, row.limit_high),
        _number(row.goal),
        _verdict(row),
    )


def _verdict(row: StudyRow) -> str:
    if row.refused:
        return f"REFUSED: {row.refused}"
    return "passed" if row.passed else "FAILED"


def _line(*cells: str) -> str:
    padded = [cell.ljust(width) for cell, width in zip(cells, WIDTHS.values(), strict=False)]
    return " ".join([*padded, cells[-1]]).rstrip()


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _limits(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{_number(low)} .. {_number(high)}"
    if low is not None:
        return f">= {_number(low)}"
    return "-" if high is None else f"<= {_number(high)}"
