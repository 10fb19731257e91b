"""The waterfall of a ledger as a picture: what is left of the error after each stage."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from metrics.attribution import Attribution

FORWARD_COLOUR, BACKWARD_COLOUR, END_COLOUR = "#3b7ea1", "#d98c3f", "#606060"


def write_waterfall(energy: Attribution, relmse: Attribution, title: str, path: Path) -> None:
    """Write both errors side by side, each stage's share in both orders, as SVG or PNG.

    Parameters
    ----------
    energy, relmse
        What is drawn.
    title
        Of the picture.
    path
        Its suffix decides the format.
    """
    # Without a fixed salt, identifiers in the SVG differ from run to run.
    with mpl.rc_context({"svg.hashsalt": title, "font.size": 9.0}):
        rows = len(energy.stages) + 3
        figure = Figure(figsize=(11.0, 1.2 + 0.34 * rows), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        _waterfall(left, energy, "energy error, mean(V) / mean(R) - 1")
        _waterfall(right, relmse, "relMSE")
        # Below the axes, where no bar can be.
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)
        figure.suptitle(title)
        is_vector = path.suffix == ".svg"
        figure.savefig(path, dpi=120, metadata={"Date": None} if is_vector else None)


def _waterfall(axes: Axes, found: Attribution, label: str) -> None:
    names = ["as it is", "noise of one frame"]
    names += [stage.name for stage in found.stages]
    names += ["all exact"]
    axes.barh(0, found.start.value, height=0.7, color=END_COLOUR)
    _whisker(axes, 0, found.start.low, found.start.high)
    left = found.start.value - found.noise.value
    axes.barh(1, found.noise.value, left=left, height=0.7, color=FORWARD_COLOUR)
    for row, stage in enumerate(found.stages, start=2):
        after = left - stage.forward.value
        is_first = row == 2
        axes.barh(
            row - 0.18, stage.forward.value, left=after, height=0.34, color=FORWARD_COLOUR,
            label="made exact after those above" if is_first else None,
        )  # fmt: skip
        half = 0.5 * (stage.forward.high - stage.forward.low)
        _whisker(axes, row - 0.18, after - half, after + half)
        axes.barh(
            row + 0.18, stage.backward.value, left=_backward_left(found, row - 2), height=0.34,
            color=BACKWARD_COLOUR, label="made exact after those below" if is_first else None,
        )  # fmt: skip
        half = 0.5 * (stage.backward.high - stage.backward.low)
        place = _backward_left(found, row - 2)
        _whisker(axes, row + 0.18, place - half, place + half)
        left = after
    last = len(names) - 1
    axes.barh(last, found.end.value, height=0.7, color=END_COLOUR)
    _whisker(axes, last, found.end.low, found.end.high)
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set_yticks(range(len(names)), names)
    # Both panels share the axis, so turning it over must not be done twice.
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel(label)


def _backward_left(found: Attribution, number: int) -> float:
    """Error that is left when a stage and all behind it are exact."""
    start = found.start.value - found.noise.value
    return start - sum(stage.backward.value for stage in found.stages[number:])


def _whisker(axes: Axes, row: float, low: float, high: float) -> None:
    axes.plot([low, high], [row, row], color="black", linewidth=1.0)
