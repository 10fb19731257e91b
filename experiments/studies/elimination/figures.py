"""The charts of what leaving out saves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from experiments.studies.check import Measured
from experiments.studies.elimination.frames import Work
from experiments.studies.figures import FigureShelf
from reports.study_figures import (
    Bounded,
    CurveFigure,
    ScatterFigure,
    ScatterPanel,
    ScatterPoint,
    Series,
    TableFigure,
    TableLine,
)

GROUP = "Eliminations"

COLUMNS = (
    "numbers that differ, or difference over its bound",
    "device time, kept over left out",
    "operations, kept over left out",
    "peak memory saved, MiB",
)

MIB = float(1 << 20)
"""Bytes of a mebibyte."""


@dataclass
class Savings:
    """What the cases that were measured saved, by name."""

    time: dict[str, Measured] = field(default_factory=dict)
    operations: dict[str, float] = field(default_factory=dict)
    memory: dict[str, float] = field(default_factory=dict)
    saved: dict[str, float] = field(default_factory=dict)
    difference: dict[str, Measured] = field(default_factory=dict)

    def note(self, name: str, difference: Measured, time: Measured, lean: Work, kept: Work) -> None:
        """Keep what a case changed, and its ratios, each kept over left out."""
        self.difference[name] = difference
        self.saved[name] = (kept.peak - lean.peak) / MIB
        self.time[name] = time
        self.operations[name] = kept.operations / lean.operations
        self.memory[name] = kept.peak / max(lean.peak, 1.0)

    def draw(self, shelf: FigureShelf) -> None:
        """Draw what was noted, and write it down."""
        if self.time:
            shelf.add(self._table())
        panels = [
            ScatterPanel(y_label=f"{what}, kept over left out", points=self._points(ratios))
            for what, ratios in (("operations", self.operations), ("peak memory", self.memory))
            if ratios
        ]
        if panels:
            shelf.add(
                ScatterFigure(
                    group=GROUP,
                    title="What each saves",
                    caption="Each mark is a scene that does not need the thing: a frame with it "
                    "kept over one with it left out. 1 saves nothing.",
                    x_label="device time, kept over left out",
                    panels=panels,
                )
            )

    def _table(self) -> TableFigure:
        return TableFigure(
            group=GROUP,
            title="What each changes and saves",
            caption="Median and quartiles of the time over turns; operations: instructions of all "
            "kernels times their lanes, those of a loop once.",
            line_label="what is left out",
            columns=list(COLUMNS),
            lines=[
                TableLine(
                    name=name,
                    cells=[
                        Bounded(value=self.difference[name].value),
                        Bounded(value=time.value, low=time.low, high=time.high),
                        Bounded(value=self.operations[name]),
                        Bounded(value=self.saved[name]),
                    ],
                )
                for name, time in self.time.items()
            ],
        )

    def _points(self, ratios: dict[str, float]) -> list[ScatterPoint]:
        return [
            ScatterPoint(
                name=name,
                family="eliminations",
                x=Bounded(value=time.value, low=time.low, high=time.high),
                y=Bounded(value=ratios[name]),
                is_front=False,
            )
            for name, time in self.time.items()
        ]


def draw_frames(
    shelf: FigureShelf, title: str, lean: Sequence[float], kept: Sequence[float]
) -> None:
    """Draw the device times of frames in the order in which they were made, seconds."""
    shelf.add(
        CurveFigure(
            group="Everything together",
            title=title,
            caption="Warm frames, in turns.",
            x_label="turn",
            y_label="device time, ms",
            is_y_log=True,
            series=[
                Series(
                    name=name,
                    x=[float(turn) for turn in range(len(times))],
                    values=[Bounded(value=1e3 * float(each)) for each in np.asarray(times)],
                )
                for name, times in (("left out", lean), ("kept", kept))
            ],
        )
    )
