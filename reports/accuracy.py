"""Records -> one self-contained HTML page: how wrong, where, and at what cost."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from reports.headline import (
    HEADLINES,
    Headline,
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
from reports.methods import Comparison, compare, detail_among, grouped, is_listed
from reports.pictures import colour_stops
from reports.plots import overview_svg, stage_time_svg
from reports.record import read_record
from reports.schema import MetricValue, Record
from reports.sections import Detail, Pictures, read_pictures
from reports.voxel_colours import QUANTITIES


@dataclass(frozen=True, kw_only=True)
class Section:
    """All that the page shows of one record."""

    key: str
    """Unique on the page."""
    record: Record
    pictures: Pictures
    headlines: list[tuple[Headline, MetricValue | None]]
    seconds: float | None
    """Of one frame of the method under test."""
    speed: float | None
    """Reference time over frame time."""
    chart: Markup | None
    samples: float | None
    """Of the voxels, a pixel."""
    comparison_key: str | None
    """Comparison that the record is part of; None where it is the only one of its scene."""
    is_listed: bool
    """Whether it is in the tables of all scenes."""
    detail: Detail
    """Which of its pictures are shown."""
    config: str
    """The configuration as indented JSON."""
    warnings: list[str]


@dataclass(frozen=True, kw_only=True)
class Part:
    """A scene on the page: one record, or several side by side."""

    section: Section | None = None
    comparison: Comparison | None = None


def accuracy_report(record_paths: Sequence[Path]) -> str:
    """Build the page; the same records give the same characters.

    Parameters
    ----------
    record_paths
        Record files; their images are read beside them and checked.

    Returns
    -------
    str
        HTML that loads nothing: style, script, pictures and charts are inside.

    Raises
    ------
    ValueError
        When there is no record, or one or an image of one is broken.
    """
    if not record_paths:
        raise ValueError("accuracy_report: no record given; make one with `vctgi report`")
    records = ordered({path: read_record(path) for path in record_paths})
    keys = {path: f"record-{index}" for index, (path, _) in enumerate(records, start=1)}
    sections: list[Section] = []
    parts: list[Part] = []
    for index, group in enumerate(grouped(records), start=1):
        key = f"scene-{index}" if len(group) > 1 else None
        found = [_section(keys[path], path, record, key, group) for path, record in group]
        sections += found
        if key is None:
            parts.append(Part(section=found[0]))
        else:
            parts.append(Part(comparison=compare(key, group, keys)))
    listed = [section.record for section in sections if section.is_listed]
    overview = overview_svg(listed, key="overview")
    environment = Environment(
        loader=PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        number=number, duration=duration, count=count_text, mebibytes=_mebibytes
    )
    page = environment.get_template("accuracy.html.j2")
    return page.render(
        sections=sections,
        parts=parts,
        headlines=HEADLINES,
        overview=None if overview is None else Markup(overview),
        style=Markup(_part("accuracy.css")),
        script=Markup(_part("accuracy.js")),
        error_colours=", ".join(colour_stops("RdBu_r")),
        flip_colours=", ".join(colour_stops("magma")),
        interval_text=interval_text,
        voxel_quantities=QUANTITIES,
        noise_bound=noise_bound,
    )


def write_accuracy_report(record_paths: Sequence[Path], output: Path) -> Path:
    """Write `accuracy_report` to a file, whose folder is made when missing; return its path."""
    page = accuracy_report(record_paths)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(page, encoding="utf-8")
    return output


def _section(
    key: str,
    path: Path,
    record: Record,
    comparison_key: str | None,
    group: Sequence[tuple[Path, Record]],
) -> Section:
    detail = detail_among(record, group)
    pictures = read_pictures(path, record, detail)
    seconds = frame_seconds(record)
    reference = record.reference
    speed = reference.seconds / seconds if reference is not None and seconds else None
    warnings = [*record.warnings, *pictures.faults]
    if record.machine.is_dirty:
        warnings.append(
            f"Made from uncommitted changes on top of {record.machine.commit[:12]}: the command "
            "below may not make the same numbers again."
        )
    if reference is None:
        warnings.append("No reference was recorded: nothing here says how wrong the picture is.")
    has_chart = record.times and detail != "none"
    chart = Markup(stage_time_svg(record.times, key=f"{key}-times")) if has_chart else None
    return Section(
        key=key,
        record=record,
        pictures=pictures,
        headlines=[(headline, find_metric(record, headline)) for headline in HEADLINES],
        seconds=seconds,
        speed=speed,
        chart=chart,
        samples=samples_per_pixel(record),
        comparison_key=comparison_key,
        is_listed=is_listed(record, group),
        detail=detail,
        config=json.dumps(record.config, indent=2, ensure_ascii=False),
        warnings=warnings,
    )


def _mebibytes(count: int) -> str:
    return f"{count / 2**20:.3g} MiB"


def _part(name: str) -> str:
    return files("reports").joinpath("templates", name).read_text(encoding="utf-8")
