"""Charts of records as SVG that is set into a page: same records, same bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from math import ceil, floor, log10

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter

from reports.headline import HEADLINES, Headline, find_metric, noise_bound
from reports.schema import Record, StageTime

INK = "#010203"
"""Stands for the page's text colour, which differs between light and dark; see `page_svg`."""

BAR_COLOUR = "#3b7ea1"
"""Reads on a white page and on a black one."""


def stage_time_svg(times: Sequence[StageTime], *, key: str) -> str:
    """Horizontal bars: median time per stage, whiskers from low to high, in the order given.

    Parameters
    ----------
    times
        At least one.
    key
        Letters and digits, unique on the page: prefix of the SVG's identifiers.

    Raises
    ------
    ValueError
        When there is no time.
    """
    if not times:
        raise ValueError("stage_time_svg: no stage time given; leave the chart out")
    with chart_style():
        figure = Figure(figsize=(6.8, 0.62 + 0.27 * len(times)), layout="constrained")
        axes = figure.subplots()
        rows = range(len(times))
        medians = [time.median_ms for time in times]
        whiskers = [
            [time.median_ms - time.low_ms for time in times],
            [time.high_ms - time.median_ms for time in times],
        ]
        axes.barh(
            rows, medians, xerr=whiskers, height=0.62, color=BAR_COLOUR,
            error_kw={"ecolor": INK, "elinewidth": 0.9},
        )  # fmt: skip
        axes.set_yticks(rows, [time.stage for time in times], parse_math=False)
        axes.invert_yaxis()
        axes.set_xlim(left=0.0)
        axes.set_xlabel("milliseconds per frame (median; whiskers: spread)")
        return page_svg(figure, axes, key)


def overview_svg(records: Sequence[Record], *, key: str) -> str | None:
    """Energy ratio and relMSE of the indirect light of every record, with intervals.

    Returns
    -------
    str or None
        None when no record has either number.
    """
    columns = [headline for headline in HEADLINES if headline.component == "indirect"]
    if not any(find_metric(record, column) for record in records for column in columns):
        return None
    with chart_style():
        figure = Figure(figsize=(9.4, 0.9 + 0.27 * len(records)), layout="constrained")
        panels = figure.subplots(1, len(columns), sharey=True, squeeze=False)[0]
        for axes, column in zip(panels, columns, strict=True):
            _dots(axes, records, column)
        labels = [row_label(record) for record in records]
        panels[0].set_yticks(range(len(records)), labels, parse_math=False)
        panels[0].set_ylim(len(records) - 0.5, -0.5)
        return page_svg(figure, panels, key)


def row_label(record: Record) -> str:
    """Scene and preset of a record, cut to what fits beside a chart."""
    label = f"{record.scene.name} \N{MIDDLE DOT} {record.preset}"
    return label if len(label) <= 36 else label[:35] + "\N{HORIZONTAL ELLIPSIS}"


def chart_style() -> AbstractContextManager[None]:
    """Return how charts of a page look, for as long as one is drawn."""
    return mpl.rc_context(
        {
            "svg.hashsalt": "vctgi",
            "svg.fonttype": "none",
            "font.size": 10.0,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.linewidth": 0.6,
            "xtick.major.width": 0.6,
            "ytick.major.width": 0.0,
        }
    )


def _dots(axes: Axes, records: Sequence[Record], column: Headline) -> None:
    """Draw one dot per record; a logarithmic axis for errors that are all above zero.

    An error that noise hides is a triangle at what it is under.
    """
    found = [(row, find_metric(record, column)) for row, record in enumerate(records)]
    points = [(row, metric) for row, metric in found if metric is not None]
    intervals = [metric.interval for _, metric in points]
    values = [metric.value for _, metric in points]
    lows = [i.low if i else value for i, value in zip(intervals, values, strict=True)]
    highs = [i.high if i else value for i, value in zip(intervals, values, strict=True)]
    axes.hlines([row for row, _ in points], lows, highs, color=BAR_COLOUR, linewidth=2.0)
    bounds = [noise_bound(metric, records[row]) for row, metric in points]
    for marker, is_hidden in (("o", False), ("<", True)):
        drawn = [
            (value if bound is None else bound, row)
            for value, bound, (row, _) in zip(values, bounds, points, strict=True)
            if (bound is not None) == is_hidden
        ]
        axes.plot(
            [x for x, _ in drawn], [row for _, row in drawn],
            linestyle="none", marker=marker, markersize=5, color=BAR_COLOUR,
        )  # fmt: skip
    ideal = points[0][1].ideal if points else None
    if ideal == 1.0:
        axes.axvline(1.0, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
    elif points and 0.0 < 10.0 * min(lows) < max(highs):
        axes.set_xscale("log")
        # Whole decades, so that at least two ticks have a label.
        axes.set_xlim(10.0 ** floor(log10(min(lows))), 10.0 ** ceil(log10(max(highs))))
        axes.xaxis.set_minor_formatter(NullFormatter())
    if axes.get_xscale() == "linear":
        axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(f"{column.label}, {column.component} light (ideal {1 if ideal == 1.0 else 0})")
    axes.grid(visible=True, axis="x", linewidth=0.4, color="#80808080")


def page_svg(figure: Figure, panels: Axes | Sequence[Axes], key: str) -> str:
    """Finish a figure: page colours instead of black on white, identifiers of its own."""
    for axes in [panels] if isinstance(panels, Axes) else panels:
        axes.set_facecolor("none")
        axes.tick_params(colors=INK, which="both")
        axes.xaxis.label.set_color(INK)
        axes.yaxis.label.set_color(INK)
        for spine in axes.spines.values():
            spine.set_color(INK)
    figure.patch.set_facecolor("none")
    buffer = io.StringIO()
    # Without these the file would carry a date, and addresses that no page needs.
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(buffer, format="svg", metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<style.*?</style>", "", text, count=1, flags=re.DOTALL)
    head, body = text.split(">", 1)
    view_box = re.search(r'viewBox="[^"]*"', head)
    assert view_box is not None, "matplotlib writes a viewBox"
    body = re.sub(r'(<\w+ )id="', rf'\1id="{key}-', body)
    body = body.replace('xlink:href="#', f'href="#{key}-').replace("url(#", f"url(#{key}-")
    body = re.sub(r"font-family: [^;]*;", "", body).replace(INK, "currentColor")
    return f"<svg {view_box.group()}>{_compact(body, key)}"


NAMED = ("point", "line", "label")
"""Parts of a chart whose names others ask for, as the drawing code gives them, with a number."""


def _compact(body: str, key: str) -> str:
    """Return an SVG's content without names that nothing asks for, blanks, and needless digits."""
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', body))

    def name(found: re.Match[str]) -> str:
        rest = found.group(1).removeprefix(f"{key}-")
        kept = found.group(1) in used or re.match(rf"(?:{'|'.join(NAMED)})-\d", rest)
        return found.group() if kept else ""

    body = re.sub(r' id="([^"]*)"', name, body)
    body = re.sub(r' (?:d|x|y|transform)="[^"]*"', _rounded, body)
    body = re.sub(r">\s+<", "><", body)
    return re.sub(r"\s*\n\s*", " ", body).strip()


def _rounded(attribute: re.Match[str]) -> str:
    """Return places to a hundredth of a pixel."""
    return re.sub(r"(\.\d\d)\d+", r"\1", attribute.group())
