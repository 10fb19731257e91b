"""Records -> one Markdown table, for a terminal, a pull request or a CI summary."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from reports.headline import (
    HEADLINES,
    count_text,
    duration,
    find_metric,
    frame_seconds,
    interval_text,
    noise_bound,
    number,
    ordered,
    samples_per_pixel,
)
from reports.record import read_record
from reports.schema import MetricValue, Record

# Whatever Markdown, or the HTML inside it, would take for markup in the text of a table cell.
MARKUP = re.compile(r"([\\`*_{}\[\]<>()#!|~&])")


def markdown_summary(record_paths: Sequence[Path]) -> str:
    """One table: a row per record, sorted by scene, the headline metrics with their intervals.

    Raises
    ------
    ValueError
        When a record is broken, or there is none.
    """
    if not record_paths:
        raise ValueError("markdown_summary: no record given; make one with `vctgi report`")
    rows = [
        _row(record) for _, record in ordered({path: read_record(path) for path in record_paths})
    ]
    titles = [f"{headline.label} ({headline.component})" for headline in HEADLINES]
    header = ["scene", "method", "back end", *titles, "samples a pixel", "time", "reference time"]
    header.append("warnings")
    rule = ["---", "---", "---", *["---:"] * (len(header) - 3)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in [header, rule, *rows])
    return (
        f"{table}\n\n"
        "Value (95 % interval unless another level is said). Energy ratio and SSIM: 1 is ideal; "
        "the others: 0 is. Samples: places where the cones of a frame read the voxels.\n"
    )


def write_markdown_summary(record_paths: Sequence[Path], output: Path) -> Path:
    """Write `markdown_summary` to a file, whose folder is made when missing; return its path."""
    text = markdown_summary(record_paths)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(text, encoding="utf-8")
    return output


def _row(record: Record) -> list[str]:
    reference = record.reference
    return [
        _cell(record.scene.name),
        _cell(f"{record.method} {record.preset}"),
        _cell(record.machine.backend),
        *(_metric(find_metric(record, headline), record) for headline in HEADLINES),
        count_text(samples_per_pixel(record)),
        duration(frame_seconds(record)),
        duration(None if reference is None else reference.seconds),
        str(len(record.warnings) + len(record.scene.unsupported)),
    ]


def _metric(metric: MetricValue | None, record: Record) -> str:
    if metric is None:
        return "\N{EN DASH}"
    bound = noise_bound(metric, record)
    if bound is not None:
        return f"below the noise (under {number(bound)})"
    interval = metric.interval
    if interval is None:
        return number(metric.value)
    level = "" if interval.level == 0.95 else f", {100.0 * interval.level:g} %"
    return f"{number(metric.value)} ({interval_text(interval)}{level})"


def _cell(text: str) -> str:
    return MARKUP.sub(r"\\\1", " ".join(text.split()))
