from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from reports.markdown import markdown_summary, write_markdown_summary

Write = Callable[..., Path]


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def test_a_row_per_record_sorted_by_scene(write: Write) -> None:
    paths = [write(record_id=name, name=name) for name in ("b", "a")]
    lines = markdown_summary(paths).splitlines()
    header, rule, *rows = [cells(line) for line in lines[:4]]
    assert {len(row) for row in (header, rule, *rows)} == {len(header)}
    assert [row[0] for row in rows] == ["a", "b"]
    found = dict(zip(header, rows[0], strict=True))
    assert found["energy ratio (indirect)"] == "0.9312 (0.9260 to 0.9364)"
    assert found["ΔE-ITP (image)"] == "3.270"
    assert found["time"] == "274 ms"
    assert found["reference time"] == "48.2 s"


def test_names_cannot_break_the_table(write: Write, awkward_name: str, tmp_path: Path) -> None:
    path = write(name=awkward_name + " | a\nb `c` [d](e)")
    text = write_markdown_summary([path], tmp_path / "new" / "summary.md").read_text("utf-8")
    lines = text.splitlines()
    assert len(cells(lines[2])) == len(cells(lines[0]))
    assert re.search(r"(?<!\\)[<`]", cells(lines[2])[0]) is None


def test_what_was_not_measured_is_a_dash(write: Write) -> None:
    row = cells(markdown_summary([write(metrics=[], times=[], reference=None)]).splitlines()[2])
    assert row[3:-1] == ["\N{EN DASH}"] * 10


def test_no_record_is_refused() -> None:
    with pytest.raises(ValueError, match="no record given; make one"):
        markdown_summary([])
