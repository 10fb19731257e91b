"""What a scene's methods make: charts of error against time, and a table of all of them."""

from __future__ import annotations

from experiments.clocks import REPETITIONS, Clocks
from experiments.studies.check import Measured
from experiments.studies.figures import FigureShelf
from experiments.studies.pareto.bench import Bench, Result, has_denoiser
from experiments.studies.pareto.cone_frames import CAMERA, FRAMES, LIGHTS, STILL
from experiments.studies.pareto.methods import DENOISED, FAMILIES, PATHS
from experiments.studies.pareto.trade_off import pareto_front
from reports.study_figures import (
    Bounded,
    ScatterFigure,
    ScatterPanel,
    ScatterPoint,
    TableFigure,
    TableLine,
)

NO_DENOISER = " Denoised path tracing is left out: the extra [denoise] is not installed."

TITLE = "Error against time"

WHAT_IS_DONE = {
    STILL: "Still frames: the voxels are kept, so cones only gather; paths start anew.",
    CAMERA: "The windows of the clipmap move with the camera by two of the finest voxels, slabs "
    "that enter are voxelized, what changed is lit again, then cones gather; paths start anew.",
    LIGHTS: "Surfaces' voxels are kept, all is lit again, then cones gather; paths start anew.",
}

MILLISECONDS = 1e3

CLOCKS = ("device", "wall", "compile")
ERRORS = ("relMSE", "FLIP", "energy")


def draw(shelf: FigureShelf, bench: Bench) -> None:
    """Keep the charts and the tables of a scene."""
    results = sorted(bench.results.values(), key=lambda each: FAMILIES.index(each.method.family))
    for kind in FRAMES:
        _draw_frames(shelf, bench.loaded.title, results, kind)
    _write_tables(shelf, bench.loaded.title, results)


def _draw_frames(shelf: FigureShelf, group: str, results: list[Result], kind: str) -> None:
    """Keep the chart of one kind of frames; errors are those of the still ones."""
    timed = [each for each in results if kind in each.clocks]
    if not timed:
        return
    shelf.add(
        ScatterFigure(
            group=group,
            title=TITLE if kind == STILL else f"{TITLE}, {kind}",
            caption=f"{WHAT_IS_DONE[kind]} "
            f"Time: median and quartiles of {REPETITIONS} warm frames by the device's clock. Large "
            "marks are on the front, which nothing beats in both time and error."
            + ("" if has_denoiser() else NO_DENOISER),
            x_label="device time of a frame, ms",
            panels=[
                _panel("relMSE, indirect light", timed, kind, [e.score.relmse for e in timed]),
                _panel("FLIP, whole picture", timed, kind, [e.score.flip for e in timed]),
            ],
            joined=[PATHS, DENOISED],
        )
    )


def _panel(label: str, results: list[Result], kind: str, errors: list[Measured]) -> ScatterPanel:
    times = [each.clocks[kind].device() for each in results]
    front = pareto_front([each.value for each in times], [each.value for each in errors])
    return ScatterPanel(
        y_label=label,
        points=[
            ScatterPoint(
                name=result.method.name,
                family=result.method.family,
                x=_bounded(time, MILLISECONDS),
                y=_bounded(error),
                is_front=index in front,
            )
            for index, (result, time, error) in enumerate(zip(results, times, errors, strict=True))
        ],
    )


def _write_tables(shelf: FigureShelf, group: str, results: list[Result]) -> None:
    """Keep a line for each method: three clocks and the errors of still frames, then the others."""
    kinds = {"still frames": (STILL,), "moving frames": (CAMERA, LIGHTS)}
    for title, shown in kinds.items():
        errors = ERRORS if STILL in shown else ()
        columns = [f"{kind}, {clock}" for kind in shown for clock in CLOCKS]
        lines = []
        for each in results:
            cells = {
                f"{kind}, {clock}": found
                for kind in shown
                if kind in each.clocks
                for clock, found in zip(CLOCKS, _times(each.clocks[kind]), strict=True)
            }
            found = (each.score.relmse, each.score.flip, each.score.energy)[: len(errors)]
            known = [*(cells.get(name) for name in columns), *map(_bounded, found)]
            lines.append(TableLine(name=each.method.name, cells=known))
        shelf.add(
            TableFigure(
                group=group,
                title=f"All methods, {title}",
                caption=f"Times in ms: median and quartiles of {REPETITIONS} warm frames; compile: "
                "the first frame less its device time, for tracing and for compiling what no "
                "method before had compiled." + (" Errors with 95 % intervals." if errors else ""),
                line_label="method",
                columns=[*columns, *errors],
                lines=lines,
            )
        )


def _times(clocks: Clocks) -> tuple[Bounded, ...]:
    """Return milliseconds by each of `CLOCKS`."""
    return (
        _bounded(clocks.device(), MILLISECONDS),
        _bounded(clocks.wall(), MILLISECONDS),
        Bounded(value=MILLISECONDS * clocks.compile),
    )


def _bounded(found: Measured, scale: float = 1.0) -> Bounded:
    if found.low is None or found.high is None:
        return Bounded(value=scale * found.value)
    return Bounded(value=scale * found.value, low=scale * found.low, high=scale * found.high)
