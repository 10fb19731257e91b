"""What `vctgi optimize` prints: parameters, views, limits, and what to make of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from experiments.optimize.findings import ViewFinding, mean_ratio
from experiments.optimize.preset_record import parameter_interval
from experiments.optimize.run import FitResult

LIMIT_TITLES = {
    "dark_excess": "light leaking",
    "missing_energy": "over-occlusion",
    "work": "samples and rays",
}


HOLDING_PUSH = 0.02
"""Share of what a limit allows from which on it is worth a line."""


def summary_lines(result: FitResult, output: Path) -> list[str]:
    """Return the tables and the verdicts of a fit as lines."""
    lines = _table(
        ["parameter", "start", "end", "95 % interval", "bounds", ""],
        [_parameter_cells(result, number) for number in range(len(result.parameters))],
    )
    lines += [""]
    lines += _table(
        ["view", "", "relMSE before", "relMSE after", "after / before", "samples", "rays", "ms"],
        [
            *(_view_cells(each, "training") for each in result.training),
            *(_view_cells(each, "held out") for each in result.held_out),
        ],
    )
    lines += ["", _objective_line(result)]
    if result.held_out:
        lines.append(_held_out_line(result.held_out))
    lines += _limit_lines(result)
    lines += _identification_lines(result)
    lines.append(
        f"{result.minimum.evaluations} points in {result.seconds:.0f} s, ended: "
        f"{result.minimum.message.rstrip('.')}"
        + (f"; {result.reused_count} frames were found finished" if result.reused_count else "")
    )
    lines.append(str(output))
    return lines


def _parameter_cells(result: FitResult, number: int) -> list[str]:
    parameter = result.parameters[number]
    interval = parameter_interval(result, number)
    note = ""
    if result.uncertainty is not None:
        if result.uncertainty.is_held[number]:
            note = "at its bound"
        elif not result.uncertainty.is_identified[number]:
            note = "NOT IDENTIFIED"
    return [
        parameter.name,
        f"{parameter.outer(float(result.start[number])):.4g}",
        f"{parameter.outer(float(result.end[number])):.4g}",
        "-" if interval is None else f"{interval.low:.4g} .. {interval.high:.4g}",
        f"{parameter.low:g} .. {parameter.high:g}",
        note,
    ]


def _view_cells(finding: ViewFinding, role: str) -> list[str]:
    before, after = finding.error
    return [
        finding.title,
        role,
        *(f"{each.value:.4f} +- {0.5 * (each.high - each.low):.4f}" for each in (before, after)),
        f"{finding.ratio.value:.3f} +- {0.5 * (finding.ratio.high - finding.ratio.low):.3f}",
        _change(finding.samples, "{:.1f}"),
        _change(finding.rays, "{:.1f}"),
        _change(finding.milliseconds, "{:.1f}"),
    ]


def _objective_line(result: FitResult) -> str:
    start, end = result.objective
    return (
        f"objective (mean over training scenes of error over that at the start): {start:.4f} -> "
        f"{end:.4f}"
    )


def _held_out_line(findings: Sequence[ViewFinding]) -> str:
    ratio = mean_ratio(findings)
    half = 0.5 * (ratio.high - ratio.low)
    return (
        f"error of held-out views changes by {100.0 * (ratio.value - 1.0):+.1f} % "
        f"+- {100.0 * half:.1f} % on the mean"
    )


def _limit_lines(result: FitResult) -> list[str]:
    """Return a line for each limit that holds the fit back."""
    lines = []
    for limit, end in result.limits:
        if limit.push(end) > HOLDING_PUSH:
            lines.append(
                f"held back by {LIMIT_TITLES[limit.name]} in "
                f"{result.training[limit.scene].title}: {limit.start:.4g} -> {end:.4g}, allowed "
                f"{limit.start + limit.allowance:.4g}"
            )
    return lines


def _identification_lines(result: FitResult) -> list[str]:
    if result.uncertainty is None:
        return []
    rows = zip(
        result.parameters, result.uncertainty.is_identified, result.uncertainty.is_held, strict=True
    )
    vague = [each.name for each, is_known, is_held in rows if not is_known and not is_held]
    if not vague:
        return []
    return [
        f"not identified by these scenes and frames: {', '.join(vague)} (interval as wide as the "
        f"bounds; condition {result.uncertainty.condition:.2g}); leave out, or give more frames or "
        "scenes"
    ]


def _change(pair: tuple[float, float], form: str) -> str:
    return f"{form.format(pair[0])} -> {form.format(pair[1])}"


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    """Return rows with columns below one another."""
    widths = [max(len(row[place]) for row in [head, *rows]) for place in range(len(head))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in [head, *rows]
    ]
