"""Figures of a study as data: maps, pictures, curves and waterfalls, drawn where they are shown."""

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


Figure = Annotated[
    MapFigure | PictureFigure | CurveFigure | WaterfallFigure, Field(discriminator="kind")
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
