"""Failed verdicts for people: a Markdown table and, on GitHub, annotations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from reports.junit import Verdict

MARKDOWN_LIMIT: Final = 1024 * 1024
"""Bytes that GitHub takes as a step summary."""
ANNOTATION_LIMIT: Final = 10
"""Annotations that GitHub shows for a step."""
CELL_LIMIT: Final = 2000
"""Characters of one table cell; the whole text is in the JUnit file."""


def markdown_summary(verdicts: Sequence[Verdict], update_command: str) -> str:
    """Write the counts, a table of the failures, and how to update; at most `MARKDOWN_LIMIT` bytes.

    Rows that do not fit are counted in the last line.
    """
    failed = [verdict for verdict in verdicts if not verdict.passed]
    head = f"## vctgi gate: {len(failed)} of {len(verdicts)} checks failed\n\n"
    if not failed:
        return head
    head += (
        "| gate | scene | kind | value | limit | why |\n| --- | --- | --- | ---: | --- | --- |\n"
    )
    command = f"\nWhen a change is meant, make and review a new baseline: `{update_command}`\n"
    left_out = f"\n{len(failed)} more failures are in the JUnit file.\n"
    room = MARKDOWN_LIMIT - sum(len(part.encode()) for part in (head, command, left_out))
    rows: list[str] = []
    for verdict in failed:
        row = _row(verdict)
        room -= len(row.encode())
        if room < 0:
            break
        rows.append(row)
    remaining = len(failed) - len(rows)
    more = f"\n{remaining} more failures are in the JUnit file.\n" if remaining else ""
    return f"{head}{''.join(rows)}{more}{command}"


def github_annotations(verdicts: Sequence[Verdict]) -> list[str]:
    """Write at most `ANNOTATION_LIMIT` workflow commands; the last one counts what is left out."""
    failed = [verdict for verdict in verdicts if not verdict.passed]
    shown = failed if len(failed) <= ANNOTATION_LIMIT else failed[: ANNOTATION_LIMIT - 1]
    titles = [_property(f"{verdict.gate} [{verdict.kind}]") for verdict in shown]
    lines = [
        f"::error title={title}::{_message(verdict.message)}"
        for title, verdict in zip(titles, shown, strict=True)
    ]
    if len(shown) < len(failed):
        lines.append(f"::error title=vctgi gate::{len(failed) - len(shown)} more checks failed")
    return lines


def _row(verdict: Verdict) -> str:
    value = "" if verdict.value is None else f"{verdict.value:.5g}"
    cells = (verdict.gate, verdict.scene, verdict.kind, value, verdict.limit, verdict.message)
    return f"| {' | '.join(_cell(cell) for cell in cells)} |\n"


def _cell(text: str) -> str:
    flat = " ".join(text.split())
    short = flat if len(flat) <= CELL_LIMIT else f"{flat[:CELL_LIMIT]}..."
    for mark, written in (("\\", "\\\\"), ("|", "\\|"), ("<", "&lt;"), ("`", "\\`"), ("*", "\\*")):
        short = short.replace(mark, written)
    return short


def _message(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _message(text).replace(":", "%3A").replace(",", "%2C")
