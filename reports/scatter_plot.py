"""Chart of many methods by two numbers: points can be pointed at, or reached by the keyboard."""

from __future__ import annotations

import re
from itertools import cycle
from math import isclose, log10

from markupsafe import escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from reports.headline import number
from reports.label_places import Box, place_labels
from reports.plots import BAR_COLOUR, INK, chart_style, page_svg
from reports.study_figures import Bounded, ScatterFigure, ScatterPanel, ScatterPoint

FAMILY_COLOURS = (BAR_COLOUR, "#b0588f", "#d98c3f", "#7a9a3a", "#5b6fc7", "#8a7f6d")
"""Of the families, in order; each reads on a white page and on a black one."""

FAMILY_MARKERS = ("o", "s", "D", "^", "v", "P")
"""Of the families, so that they differ without their colours, too."""

FRONT_SIZE, SIZE = 8.0, 4.5
"""Of marks, points of type."""

LABEL_SIZE = 8.0
UNNAMED = 3
"""Rank of points whose names only the readout says."""
ROOM = 0.06
"""Share of an axis that is left free at each end."""
LEAST_DECADES = 0.1
SHORT_DECADES = 2.5
"""An axis shorter than this has a label at 1, 2 and 5 of each decade."""


def scatter_svg(figure: ScatterFigure, *, key: str) -> str:
    """Points with their intervals, fronts and lines; groups `data-point` hold a point each.

    A point that noise hides, whose value is not above zero, is drawn as a bound: hollow, at the
    upper end of its interval.

    Parameters
    ----------
    figure
        What is drawn.
    key
        Letters, digits and hyphens, unique on the page.
    """
    styles = dict(
        zip(
            figure.families,
            zip(cycle(FAMILY_COLOURS), cycle(FAMILY_MARKERS), strict=False),
            strict=False,
        )
    )
    with chart_style():
        count = len(figure.panels)
        chart = Figure(figsize=(5.5 * count + 0.4, 5.0), layout="constrained")
        drawn = chart.subplots(1, count, squeeze=False)[0]
        shown: dict[str, ScatterPoint] = {}
        for number_, (axes, panel) in enumerate(zip(drawn, figure.panels, strict=True)):
            shown |= _draw(axes, panel, number_, styles, figure.joined)
            axes.set_xlabel(figure.x_label, parse_math=False)
            axes.set_ylabel(panel.y_label, parse_math=False)
        _legend(chart, drawn[0], figure, styles)
        chart.draw_without_rendering()
        # Labels must not move what they were placed by.
        chart.set_layout_engine("none")
        for number_, (axes, panel) in enumerate(zip(drawn, figure.panels, strict=True)):
            _label(axes, panel, number_, figure.joined)
        text = page_svg(chart, list(drawn), key)
    return _with_points(text, key, figure, shown)


def scatter_file(figure: ScatterFigure) -> str:
    """Return the chart as a file of its own, dark on white, for pages that show pictures."""
    text = scatter_svg(figure, key=figure.key)
    opening = (
        '<svg xmlns="http://www.w3.org/2000/svg" '
        'style="color: #1b1b1b; background: #fff; font-family: sans-serif" '
    )
    return text.replace("<svg ", opening, 1) + "\n"


def point_text(point: ScatterPoint, x_label: str, y_label: str) -> str:
    """Return what a reader is told of a point."""
    front = "; on the front" if point.is_front else ""
    return (
        f"{point.name} ({point.family}{front}): {y_label} {_words(point.y)}, "
        f"{x_label} {_words(point.x)}"
    )


def _words(found: Bounded) -> str:
    if found.low is None or found.high is None or isclose(found.low, found.high):
        return number(found.value)
    return f"{number(found.value)} [{number(found.low)} to {number(found.high)}]"


def _height(point: ScatterPoint) -> float | None:
    """Return where a point stands, or None where even its interval is below zero."""
    if point.y.value > 0.0:
        return point.y.value
    return point.y.high if point.y.high is not None and point.y.high > 0.0 else None


def _draw(
    axes: Axes,
    panel: ScatterPanel,
    panel_number: int,
    styles: dict[str, tuple[str, str]],
    joined: list[str],
) -> dict[str, ScatterPoint]:
    """Draw a panel; return its points by the names of their groups."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    places = [(p, y) for p in panel.points if (y := _height(p)) is not None]
    low, high = _limits([y for _, y in places])
    axes.set_xlim(*_limits([p.x.value for p, _ in places]))
    axes.set_ylim(low, high)
    for family in joined:
        line = sorted((p.x.value, y) for p, y in places if p.family == family)
        if len(line) > 1:
            axes.plot(
                *zip(*line, strict=True), color=styles[family][0], linewidth=1.2, alpha=0.7,
                gid=f"line-{panel_number}-{list(styles).index(family)}",
            )  # fmt: skip
    front = sorted((p.x.value, y) for p, y in places if p.is_front)
    if len(front) > 1:
        axes.step(
            *zip(*front, strict=True), where="post", color=INK, linewidth=0.9,
            linestyle=(0, (4, 3)), alpha=0.6,
        )  # fmt: skip
    found = {}
    for index, (point, y) in enumerate(places):
        colour, marker = styles[point.family]
        name = f"point-{panel_number}-{index}"
        found[name] = point
        if point.y.low is not None and point.y.high is not None and point.y.high > 0.0:
            ends = (max(point.y.low, low), min(point.y.high, high))
            axes.vlines(
                [point.x.value], *ends, color=colour, linewidth=1.0, alpha=0.6, gid=f"{name}-y"
            )
        if point.x.low is not None and point.x.high is not None and point.x.low > 0.0:
            axes.hlines(
                [y], point.x.low, point.x.high, color=colour, linewidth=1.0, alpha=0.6,
                gid=f"{name}-x",
            )  # fmt: skip
        axes.plot(
            [point.x.value], [y], linestyle="none", marker=marker, color=colour,
            markersize=FRONT_SIZE if point.is_front else SIZE, markeredgewidth=1.2,
            markerfacecolor=colour if point.y.value > 0.0 else "none", gid=name,
        )  # fmt: skip
    axes.grid(visible=True, which="major", linewidth=0.4, color="#80808080")
    axes.set_axisbelow(True)
    for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, (low, high))):
        is_short = log10(ends[1] / ends[0]) < SHORT_DECADES
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if is_short else (1.0,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    return found


def _limits(values: list[float]) -> tuple[float, float]:
    low, high = log10(min(values)), log10(max(values))
    margin = max(ROOM * (high - low), LEAST_DECADES)
    return 10.0 ** (low - margin), 10.0 ** (high + margin)


def _label(axes: Axes, panel: ScatterPanel, panel_number: int, joined: list[str]) -> None:
    """Name the first family, the front and the ends of lines, as far as there is room."""
    places = [(p, y) for p in panel.points if (y := _height(p)) is not None]
    ends = [
        end
        for family in joined
        if (line := [p for p, _ in places if p.family == family])
        for end in (line[0], line[-1])
    ]

    def rank(point: ScatterPoint) -> int:
        if point.family in joined:
            return 2 if point in ends else UNNAMED
        if point.family == panel.points[0].family:
            return 0
        return 1 if point.is_front else UNNAMED

    named = sorted(places, key=lambda each: rank(each[0]))
    names = [p.name for p, _ in named if rank(p) < UNNAMED]
    # A canvas holds `dpi` pixels in 72 points of type.
    scale = 72.0 / axes.figure.dpi
    corners = axes.get_window_extent()
    frame = Box(*(scale * each for each in (corners.x0, corners.y0, corners.x1, corners.y1)))
    at = []
    for p, y in named:
        x_px, y_px = axes.transData.transform((p.x.value, y))
        at.append((scale * float(x_px), scale * float(y_px)))
    labels = place_labels(at, names, frame, LABEL_SIZE)
    for index, ((point, y), (x_pt, y_pt), place) in enumerate(zip(named, at, labels, strict=False)):
        if place is None:
            continue
        axes.annotate(
            point.name, (point.x.value, y), (place.x - x_pt, place.y - y_pt),
            textcoords="offset points", ha="center", va="center", fontsize=LABEL_SIZE, color=INK,
            parse_math=False, gid=f"label-{panel_number}-{index}",
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "#808080"}
            if place.is_far else None,
        )  # fmt: skip


def _legend(
    chart: Figure, axes: Axes, figure: ScatterFigure, styles: dict[str, tuple[str, str]]
) -> None:
    handles = [
        axes.plot([], [], linestyle="none", marker=marker, color=colour, label=family)[0]
        for family, (colour, marker) in styles.items()
    ]
    legend = chart.legend(
        handles, figure.families, loc="outside lower center", ncols=min(3, len(handles)),
        frameon=False,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_color(INK)
        text.set_parse_math(False)


def _with_points(
    text: str, key: str, figure: ScatterFigure, points: dict[str, ScatterPoint]
) -> str:
    """Give the groups of points what a reader, a script and a screen reader ask for."""
    families = figure.families

    def opened(found: re.Match[str]) -> str:
        name, part = found.group(1), found.group(2)
        panel = figure.panels[int(name.split("-")[1])]
        point = points[name]
        family = families.index(point.family)
        if part:
            return f'<g id="{key}-{name}{part}" data-family="{family}"'
        words = escape(point_text(point, figure.x_label, panel.y_label))
        return (
            f'<g id="{key}-{name}" data-family="{family}" data-point="{words}" tabindex="0" '
            f'role="img" aria-label="{words}"'
        )

    text = re.sub(rf'<g id="{re.escape(key)}-(point-\d+-\d+)(-[xy])?"', opened, text)
    return re.sub(
        rf'<g id="({re.escape(key)}-line-\d+-(\d+))"', r'<g id="\1" data-family="\2"', text
    )
