"""Charts of a study as SVG that is set into a page: curves with intervals, and waterfalls."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import (
    FixedLocator,
    FuncFormatter,
    LogLocator,
    MaxNLocator,
    NullLocator,
)

from reports.plots import BAR_COLOUR, INK, chart_style, page_svg
from reports.study_figures import Bounded, CurveFigure, Series, WaterfallFigure, WaterfallPanel

LINE_COLOURS = (BAR_COLOUR, "#d98c3f", "#7a9a3a", "#b0588f", "#8a7f6d", "#5b6fc7")
"""Of the series, in order; each reads on a white page and on a black one."""

MARKERS = ("o", "s", "^", "D", "v", "P")
"""Of the series, so that they differ without their colours, too."""

FORWARD_COLOUR, BACKWARD_COLOUR, END_COLOUR = BAR_COLOUR, "#d98c3f", "#808080"

MOST_TICKS = 8
"""Places on a logarithmic axis that all have their own label."""

LEAST_SPAN = 0.01
"""Of a linear axis, over the largest value."""

MOST_MARKED = 40
"""Points of a series beyond which none has a mark."""


def curve_svg(figure: CurveFigure, *, key: str) -> str:
    """Lines with their intervals, as whiskers, or as a band where there are many points.

    Parameters
    ----------
    figure
        What is drawn.
    key
        Letters, digits and hyphens, unique on the page.
    """
    with chart_style():
        chart = Figure(figsize=(6.4, 3.5), layout="constrained")
        axes = chart.subplots()
        for series, colour, marker in zip(
            figure.series, cycle(LINE_COLOURS), cycle(MARKERS), strict=False
        ):
            _line(axes, series, colour, marker)
        _scale(axes, figure)
        axes.set_xlabel(figure.x_label, parse_math=False)
        axes.set_ylabel(figure.y_label, parse_math=False)
        axes.grid(visible=True, linewidth=0.4, color="#80808080")
        if len(figure.series) > 1:
            _legend(chart, axes)
        return page_svg(chart, axes, key)


def waterfall_svg(figure: WaterfallFigure, *, key: str) -> str:
    """Each stage's share in both orders, from the error as it is to what is left over.

    Parameters
    ----------
    figure, key
        As `curve_svg` takes them.
    """
    with chart_style():
        rows = len(figure.panels[0].stages) + 3
        chart = Figure(
            figsize=(1.6 + 4.2 * len(figure.panels), 1.1 + 0.34 * rows), layout="constrained"
        )
        panels = chart.subplots(1, len(figure.panels), sharey=True, squeeze=False)[0]
        for axes, panel in zip(panels, figure.panels, strict=True):
            _waterfall(axes, panel)
        _legend(chart, panels[0])
        return page_svg(chart, list(panels), key)


def _line(axes: Axes, series: Series, colour: str, marker: str) -> None:
    values = np.array([each.value for each in series.values])
    lows, highs = (
        np.array([each.value if end is None else end for each, end in ends])
        for ends in (
            [(each, each.low) for each in series.values],
            [(each, each.high) for each in series.values],
        )
    )
    is_marked = len(values) <= MOST_MARKED
    if is_marked:
        axes.vlines(series.x, lows, highs, color=colour, linewidth=1.2)
    elif (lows < highs).any():
        axes.fill_between(series.x, lows, highs, color=colour, alpha=0.25, linewidth=0.0)
    axes.plot(
        series.x, values, color=colour, linewidth=1.4, label=series.name,
        marker=marker if is_marked else None, markersize=4.5,
    )  # fmt: skip


def _scale(axes: Axes, figure: CurveFigure) -> None:
    places = sorted({x for series in figure.series for x in series.x})
    values = [each.value for series in figure.series for each in series.values]
    if figure.is_x_log and places[0] > 0.0:
        axes.set_xscale("log")
    else:
        axes.xaxis.set_major_locator(MaxNLocator(8))
    if len(places) <= MOST_TICKS and places[0] > 0.0:
        axes.xaxis.set_major_locator(FixedLocator(places))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xticks(places, [f"{place:g}" for place in places])
    if figure.is_y_log and min(values) > 0.0:
        axes.set_yscale("log")
        # Ends of intervals below zero must not stretch a logarithmic axis.
        axes.set_ylim(min(values) / 2.0, None)
        axes.yaxis.set_major_formatter(FuncFormatter(_tick))
        axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axes.yaxis.set_minor_formatter(FuncFormatter(_tick))
    else:
        _open_up(axes, values)


def _open_up(axes: Axes, values: Sequence[float]) -> None:
    """Let what is flat look flat: rounding must not fill a chart."""
    axes.ticklabel_format(axis="y", useOffset=False)
    low, high = axes.get_ylim()
    middle, least = 0.5 * (low + high), LEAST_SPAN * max(abs(value) for value in values)
    if high - low < least:
        axes.set_ylim(middle - 0.5 * least, middle + 0.5 * least)


def _tick(value: float, _place: int | None) -> str:
    return f"{value:g}"


def _legend(chart: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    # Outside the axes, where nothing is drawn.
    legend = chart.legend(
        handles, labels, loc="outside lower center", ncols=min(3, len(labels)), frameon=False
    )
    for text in legend.get_texts():
        text.set_color(INK)
        text.set_parse_math(False)


def _waterfall(axes: Axes, panel: WaterfallPanel) -> None:
    names = ["as it is", "noise of one frame"]
    names += [stage.name for stage in panel.stages]
    names += ["all exact"]
    axes.barh(0, panel.start.value, height=0.7, color=END_COLOUR)
    _whisker(axes, 0, panel.start)
    left = panel.start.value - panel.noise.value
    axes.barh(1, panel.noise.value, left=left, height=0.7, color=FORWARD_COLOUR)
    backward = left - sum(stage.backward.value for stage in panel.stages)
    for row, stage in enumerate(panel.stages, start=2):
        labels = ("made exact after those above", "made exact after those below")
        forward_label, backward_label = labels if row == 2 else (None, None)
        _whisker(axes, row - 0.18, stage.forward, left)
        left -= stage.forward.value
        axes.barh(
            row - 0.18, stage.forward.value, left=left, height=0.34, color=FORWARD_COLOUR,
            label=forward_label,
        )  # fmt: skip
        axes.barh(
            row + 0.18, stage.backward.value, left=backward, height=0.34, color=BACKWARD_COLOUR,
            label=backward_label,
        )  # fmt: skip
        # This order ends at the first stage: what is left grows downwards.
        backward += stage.backward.value
        _whisker(axes, row + 0.18, stage.backward, backward)
    last = len(names) - 1
    axes.barh(last, panel.end.value, height=0.7, color=END_COLOUR)
    _whisker(axes, last, panel.end)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(names)), names, parse_math=False)
    # Both panels share the axis, so turning it over must not be done twice.
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.grid(visible=True, axis="x", linewidth=0.4, color="#80808080")
    axes.set_axisbelow(True)
    axes.set_xlabel(panel.label, parse_math=False)


def _whisker(axes: Axes, row: float, found: Bounded, before: float | None = None) -> None:
    """Draw the interval of a number, or of what it leaves of the error before it."""
    if found.low is None or found.high is None:
        return
    ends = [found.low, found.high]
    if before is not None:
        ends = [before - found.high, before - found.low]
    axes.hlines([row], ends[:1], ends[1:], color=INK, linewidth=1.0)
