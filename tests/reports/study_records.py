"""Synthetic records of studies with every kind of figure, made without a renderer."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from reports.image_files import write_image
from reports.schema import Machine
from reports.study_figures import (
    Bounded,
    CurveFigure,
    Definition,
    Figure,
    MapFigure,
    PictureFigure,
    Series,
    TableFigure,
    TableLine,
    WaterfallFigure,
    WaterfallPanel,
    WaterfallStage,
)
from reports.study_record import StudyRecord, StudyRow, record_text

GROUP = "rooms"


def row(check: str, value: float | None, limit_high: float | None = None, **more: Any) -> StudyRow:
    passed = value is not None and (limit_high is None or value <= limit_high)
    return StudyRow(
        check=check,
        configuration=more.pop("configuration", "plain"),
        scene="none",
        value=value,
        limit_high=limit_high,
        passed=passed,
        how=f"vctgi study x --only {check}",
        **more,
    )


def curve(title: str = "Curve", **more: Any) -> CurveFigure:
    values = [Bounded(value=0.1, low=-0.02, high=0.2), Bounded(value=0.01)]
    lines = [Series(name=name, x=[0.25, 2.0], values=values) for name in ("turned", "$x^2$ <b>&")]
    return CurveFigure(
        group=GROUP, title=title, x_label="thickness", y_label="ratio", series=lines, **more
    )


def waterfall() -> WaterfallFigure:
    share = Bounded(value=0.02, low=0.01, high=0.03)
    stage = {"forward": share, "backward": share, "interaction": Bounded(value=0.0)}
    panels = [
        WaterfallPanel(
            label=label,
            start=Bounded(value=0.05, low=0.04, high=0.06),
            noise=Bounded(value=0.0),
            stages=[WaterfallStage(name=name, **stage) for name in ("light maps", "pixels")],
            end=Bounded(value=0.01, low=-0.01, high=0.03),
            interaction=0.0125,
        )
        for label in ("energy error", "relMSE")
    ]
    return WaterfallFigure(group=GROUP, title="Waterfall", caption="falls", panels=panels)


def table() -> TableFigure:
    lines = [
        TableLine(name="cones <i>&", cells=[Bounded(value=0.5, low=0.25, high=0.75), None]),
        TableLine(name="paths", cells=[None, Bounded(value=-0.125)]),
    ]
    return TableFigure(
        group=GROUP,
        title="Side by side",
        caption="read",
        line_label="by",
        columns=["slope", "x|y"],
        lines=lines,
    )


def pictures(folder: Path) -> list[Figure]:
    """Write a map, a signed map and a picture into a folder beside the record."""
    ramp = np.linspace(-1.0, 1.0, 12 * 8).reshape(8, 12)
    files = {
        name: write_image(folder / f"{name}.exr", values, name)
        for name, values in (("map", ramp), ("picture", np.repeat(np.abs(ramp)[..., None], 3, 2)))
    }
    return [
        MapFigure(group=GROUP, title="Leaks", caption="where", file=files["map"], low=0, high=1,
                  unit="of the light"),
        MapFigure(group=GROUP, title="Changes", file=files["map"], low=-1, high=1),
        PictureFigure(group=GROUP, title="Seen", file=files["picture"], exposure=0.5),
    ]  # fmt: skip


def record(**changes: Any) -> StudyRecord:
    fields: dict[str, Any] = {
        "study": "leaking",
        "quick": False,
        "created": datetime(2026, 1, 31, 12, tzinfo=UTC),
        "command": "vctgi study leaking",
        "rows": [row("share", 0.02, 0.1, low=0.01, high=0.03), row("aim", 0.5, goal=0.0)],
        "machine": Machine(
            backend="llvm_ad_rgb",
            device="LLVM 19.1",
            processor="a processor",
            core_count=2,
            memory_gib=7.7,
            system="Linux",
            python="3.11.2",
            versions={"mitsuba": "3.9.1"},
            commit="0123456789abcdef0123456789abcdef01234567",
            is_dirty=False,
        ),
        "question": "How much came through?",
        "definitions": [Definition(name="L1", formula="dark / lit", source="metrics/leaking.py")],
    }
    return StudyRecord.model_validate(fields | changes)


def written(folder: Path, stem: str = "leaking", **changes: Any) -> Path:
    """Write a record with all kinds of figures; return its path."""
    figures = [*pictures(folder / stem), curve(is_x_log=True, is_y_log=True), waterfall(), table()]
    path = folder / f"{stem}.json"
    path.write_text(record_text(record(**{"figures": figures} | changes)), encoding="utf-8")
    return path
