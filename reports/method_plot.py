"""Chart of the methods of one scene: error against what they read and against time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log10

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from reports.headline import (
    HEADLINES,
    PEER_PREFIX,
    find_metric,
    frame_seconds,
    is_peer,
    noise_bound,
    samples_per_pixel,
)
from reports.label_places import Box, place_labels
from reports.plots import BAR_COLOUR, INK, chart_style, page_svg
from reports.schema import MetricValue, Record

PEER_COLOUR = "#c26a2e"
"""Of other systems' recipes; reads on a white page and on a black one."""

SCALED_SUFFIX = ":published"
"""What names of recipes end with that apply the other system's own scale."""

LABEL_SIZE = 8.0
"""Of the names of the points, points of type."""

ROOM = 0.08
"""Share of an axis that is left free at each end."""

SHORT_DECADES = 2.5
"""An axis shorter than this has a label at 1, 2 and 5 of each decade."""

ERROR = next(each for each in HEADLINES if (each.key, each.component) == ("relmse", "indirect"))


Measure = Callable[[Record], float | None]


@dataclass(frozen=True)
class _Point:
    """One method in one panel."""

    name: str
    x: float
    metric: MetricValue
    bound: float | None
    """What the error is under, where the noise hides it."""
    is_peer: bool

    @property
    def is_scaled(self) -> bool:
        return self.name.endswith(SCALED_SUFFIX)

    @property
    def is_hidden(self) -> bool:
        """Whether the noise hides the error, so that only a bound of it can be drawn."""
        return self.bound is not None

    @property
    def y(self) -> float:
        """The error, or what it is under where the noise hides it."""
        return self.metric.value if self.bound is None else self.bound


def method_svg(records: Sequence[Record], *, key: str) -> str | None:
    """Draw relMSE of the indirect light against samples a pixel and against time, both log-log.

    Parameters
    ----------
    records
        Methods of one scene, each compared with the same reference.
    key
        Letters and digits, unique on the page.

    Returns
    -------
    str or None
        None when fewer than two records have what is drawn.
    """
    panels = {
        "samples of the voxels a pixel": _points(records, samples_per_pixel),
        "seconds a frame": _points(records, frame_seconds),
    }
    panels = {title: points for title, points in panels.items() if len(points) >= 2}
    if not panels:
        return None
    with chart_style():
        figure = Figure(figsize=(11.0 if len(panels) > 1 else 6.0, 4.6), layout="constrained")
        drawn = figure.subplots(1, len(panels), squeeze=False)[0]
        for axes, (title, points) in zip(drawn, panels.items(), strict=True):
            _draw(axes, points)
            axes.set_xlabel(title)
        drawn[0].set_ylabel(f"{ERROR.label}, indirect light")
        figure.draw_without_rendering()
        # Labels must not move what they were placed by.
        figure.set_layout_engine("none")
        for axes, points in zip(drawn, panels.values(), strict=True):
            _label(axes, points)
        return page_svg(figure, drawn, key)


def _points(records: Sequence[Record], measure: Measure) -> list[_Point]:
    """Return records that a logarithmic chart can show."""
    found = []
    for record in records:
        x, metric = measure(record), find_metric(record, ERROR)
        if x is None or x <= 0.0 or metric is None:
            continue
        name, bound = record.preset.removeprefix(PEER_PREFIX), noise_bound(metric, record)
        point = _Point(name, x, metric, bound, is_peer(record))
        if point.y > 0.0:
            found.append(point)
    return found


def _draw(axes: Axes, points: Sequence[_Point]) -> None:
    """Draw the points with their intervals, each recipe joined to its scaled version."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*_limits([each.x for each in points]))
    low, high = _limits([each.y for each in points])
    axes.set_ylim(low, high)
    plain = {each.name: each for each in points if not each.is_scaled}
    for each in points:
        colour = PEER_COLOUR if each.is_peer else BAR_COLOUR
        marker = "v" if each.is_hidden else "D" if each.is_scaled else "o"
        axes.plot(
            [each.x], [each.y], linestyle="none", marker=marker, color=colour,
            markersize=4.5 if each.is_scaled else 5.5, markeredgewidth=1.2,
            markerfacecolor="none" if each.is_peer else colour,
        )  # fmt: skip
        interval = each.metric.interval
        if interval is not None and interval.high > 0.0:
            ends = max(interval.low, low), min(interval.high, high)
            axes.vlines([each.x], *ends, color=colour, linewidth=1.0, alpha=0.55)
        partner = plain.get(each.name.removesuffix(SCALED_SUFFIX))
        if each.is_scaled and partner is not None:
            axes.plot(
                [partner.x, each.x], [partner.y, each.y],
                color=colour, linewidth=0.7, alpha=0.6, linestyle=(0, (2, 2)),
            )  # fmt: skip
    axes.grid(visible=True, which="major", linewidth=0.4, color="#80808080")
    for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, (low, high))):
        is_short = log10(ends[1] / ends[0]) < SHORT_DECADES
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if is_short else (1.0,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def _limits(values: Sequence[float]) -> tuple[float, float]:
    """Return ends of a logarithmic axis with room around the values, at least a factor of two."""
    low, high = log10(min(values)), log10(max(values))
    margin = max(ROOM * (high - low), 0.15)
    return 10.0 ** (low - margin), 10.0 ** (high + margin)


def _label(axes: Axes, points: Sequence[_Point]) -> None:
    """Name the points; a scaled recipe has the name of the plain one that it is joined to."""
    names = {each.name for each in points}
    named = [p for p in points if p.name.removesuffix(SCALED_SUFFIX) not in names - {p.name}]
    rest = [p for p in points if p not in named]
    # Ours first: where there is no room for all, the others' names give way.
    named.sort(key=lambda each: each.is_peer)
    # A canvas holds `dpi` pixels in 72 points of type.
    scale = 72.0 / axes.figure.dpi
    corners = axes.get_window_extent()
    frame = Box(*(scale * each for each in (corners.x0, corners.y0, corners.x1, corners.y1)))
    places = [
        tuple(scale * float(c) for c in axes.transData.transform((each.x, each.y)))
        for each in (*named, *rest)
    ]
    at = [(x, y) for x, y in places]
    for each, (x, y), place in zip(
        named, at, place_labels(at, [p.name for p in named], frame, LABEL_SIZE), strict=False
    ):
        if place is None:
            continue
        axes.annotate(
            each.name, (each.x, each.y), (place.x - x, place.y - y), textcoords="offset points",
            ha="center", va="center", fontsize=LABEL_SIZE, color=INK, parse_math=False,
            fontweight="normal" if each.is_peer else "bold",
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "#808080"}
            if place.is_far else None,
        )  # fmt: skip
