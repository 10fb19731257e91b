"""Figures of a study as data: maps, pictures, curves, waterfalls, points, tables."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from reports.schema import ImageFile


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Bounded(_Part):
    """A number and the ends of its 95 % interval, of which both are None where it has none."""

    value: float
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Bounded:
        if (self.low is None) != (self.high is None):
            raise ValueError(f"value {self.value}: an interval has two ends or none")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low {self.low} must not exceed high {self.high}")
        return self


class _Figure(_Part):
    group: str
    """What it belongs to: figures of one group stand side by side."""
    title: str
    """Of the figure, unique in its group."""
    caption: str = ""
    """What there is to see."""

    @property
    def key(self) -> str:
        """Return a name made of letters, digits and hyphens: of its file, and on the page."""
        return figure_key(self.group, self.title)


class MapFigure(_Figure):
    """One number for each pixel."""

    kind: Literal["map"] = "map"
    file: ImageFile
    """One channel, beside the record."""
    low: float
    high: float
    """Ends of the colour scale; values beyond them have the colours of the ends. A scale from below
    zero to as far above has two hues, any other one."""
    unit: str = ""

    @model_validator(mode="after")
    def _has_a_scale(self) -> MapFigure:
        if not self.low < self.high:
            raise ValueError(f"map {self.title!r}: low {self.low} must be below high {self.high}")
        return self


class PictureFigure(_Figure):
    """Linear radiance, shown with the plain sRGB curve."""

    kind: Literal["picture"] = "picture"
    file: ImageFile
    """Three channels, beside the record."""
    exposure: float
    """Stops."""


class Series(_Part):
    """One line of a chart."""

    name: str
    x: list[float] = Field(min_length=1)
    values: list[Bounded]

    @model_validator(mode="after")
    def _complete(self) -> Series:
        if len(self.x) != len(self.values):
            raise ValueError(
                f"series {self.name!r}: {len(self.x)} places but {len(self.values)} values"
            )
        return self


class CurveFigure(_Figure):
    """Lines over one axis."""

    kind: Literal["curve"] = "curve"
    x_label: str
    y_label: str
    is_x_log: bool = False
    is_y_log: bool = False
    """Logarithmic where all values allow it."""
    series: list[Series] = Field(min_length=1)


class WaterfallStage(_Part):
    """What one stage owns."""

    name: str
    forward: Bounded
    """By how much the error falls when it is made exact after those before it."""
    backward: Bounded
    """The same after those behind it."""
    interaction: Bounded
    """The first less the second."""


class WaterfallPanel(_Part):
    """One kind of error, by stages."""

    label: str
    """What is measured, on its axis."""
    start: Bounded
    """As it is."""
    noise: Bounded
    """What of it the noise of one frame owns."""
    stages: list[WaterfallStage] = Field(min_length=1)
    end: Bounded
    """With all stages exact."""
    interaction: float
    """What no order of the stages shares out."""


class WaterfallFigure(_Figure):
    """From an error as it is to what is left with all stages exact."""

    kind: Literal["waterfall"] = "waterfall"
    panels: list[WaterfallPanel] = Field(min_length=1)

    @model_validator(mode="after")
    def _same_stages(self) -> WaterfallFigure:
        names = {tuple(stage.name for stage in panel.stages) for panel in self.panels}
        if len(names) != 1:
            raise ValueError(f"waterfall {self.title!r}: its panels must have the same stages")
        return self


class ScatterPoint(_Part):
    """One of many that are compared by two numbers."""

    name: str
    family: str
    """Of its kind: points of one family look alike."""
    x: Bounded
    y: Bounded
    is_front: bool
    """Whether no other point is better in both numbers."""


class ScatterPanel(_Part):
    """Points by two numbers, of which smaller ones are better; both axes are logarithmic."""

    y_label: str
    points: list[ScatterPoint] = Field(min_length=1)


class ScatterFigure(_Figure):
    """Points in panels that share the first axis, such as errors over time."""

    kind: Literal["scatter"] = "scatter"
    x_label: str
    panels: list[ScatterPanel] = Field(min_length=1)
    joined: list[str] = []
    """Families whose points are joined by a line."""

    @model_validator(mode="after")
    def _can_be_drawn(self) -> ScatterFigure:
        points = [point for panel in self.panels for point in panel.points]
        if any(not point.x.value > 0.0 for point in points):
            raise ValueError(f"scatter {self.title!r}: a logarithmic axis has no place for x <= 0")
        if not any(point.y.value > 0.0 for point in points):
            raise ValueError(f"scatter {self.title!r}: no point has y > 0")
        return self

    @property
    def families(self) -> list[str]:
        """Return the families in the order of their first points."""
        return list(dict.fromkeys(p.family for panel in self.panels for p in panel.points))


class TableLine(_Part):
    """One line of a table."""

    name: str
    cells: list[Bounded | None]
    """One for each column; None where the column has nothing to say of this line."""


class TableFigure(_Figure):
    """Numbers that are read side by side."""

    kind: Literal["table"] = "table"
    line_label: str
    """What the lines are names of."""
    columns: list[str] = Field(min_length=1)
    lines: list[TableLine] = Field(min_length=1)

    @model_validator(mode="after")
    def _is_rectangular(self) -> TableFigure:
        for line in self.lines:
            if len(line.cells) != len(self.columns):
                raise ValueError(
                    f"table {self.title!r}: line {line.name!r} has {len(line.cells)} cells for "
                    f"{len(self.columns)} columns"
                )
        return self


Figure = Annotated[
    MapFigure | PictureFigure | CurveFigure | WaterfallFigure | ScatterFigure | TableFigure,
    Field(discriminator="kind"),
]


class Definition(_Part):
    """What a number of a study is."""

    name: str
    formula: str
    source: str
    """Where it is computed, and where it comes from."""


def figure_key(group: str, title: str) -> str:
    """Return the key of a figure.

    Raises
    ------
    ValueError
        Neither name holds a letter or a digit.
    """
    key = re.sub(r"[^a-z0-9]+", "-", f"{group} {title}".lower()).strip("-")
    if not key:
        raise ValueError(f"a figure needs a name, got group {group!r} and title {title!r}")
    return key
