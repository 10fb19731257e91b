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
    "that enter are voxelized, all is lit again, then cones gather; paths start anew.",
    LIGHTS: "Surfaces' voxels are kept, all is lit again, then cones gather; paths start anew.",
}

MILLISECONDS = 1e3

DEVICE, WALL, COMPILE = "device", "wall", "first frame less device"
ERRORS = ("relMSE", "FLIP", "energy")


def draw(shelf: FigureShelf, bench: Bench) -> None:
    """Keep the charts and the table of a scene."""
    results = sorted(bench.results.values(), key=lambda each: FAMILIES.index(each.method.family))
    for kind in FRAMES:
        _draw_frames(shelf, bench.loaded.title, results, kind)
    _write_table(shelf, bench.loaded.title, results)


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


def _write_table(shelf: FigureShelf, group: str, results: list[Result]) -> None:
    """Keep a line for each method: its three clocks for each kind of frame, and its errors."""
    columns = [f"{kind}, {clock}" for kind in FRAMES for clock in (DEVICE, WALL, COMPILE)]
    lines = []
    for each in results:
        cells: dict[str, Bounded] = {}
        for kind, clocks in each.clocks.items():
            cells |= {f"{kind}, {name}": found for name, found in _times(clocks).items()}
        errors = (each.score.relmse, each.score.flip, each.score.energy)
        lines.append(
            TableLine(
                name=each.method.name,
                cells=[*(cells.get(name) for name in columns), *map(_bounded, errors)],
            )
        )
    shelf.add(
        TableFigure(
            group=group,
            title="All methods",
            caption=f"Times in ms: median and quartiles of {REPETITIONS} warm frames. The first "
            "frame less its device time is what tracing took, and compiling of what no method "
            "before had compiled. Errors with 95 % intervals.",
            line_label="method",
            columns=[*columns, *ERRORS],
            lines=lines,
        )
    )


def _times(clocks: Clocks) -> dict[str, Bounded]:
    return {
        DEVICE: _bounded(clocks.device(), MILLISECONDS),
        WALL: _bounded(clocks.wall(), MILLISECONDS),
        COMPILE: Bounded(value=MILLISECONDS * clocks.compile),
    }


def _bounded(found: Measured, scale: float = 1.0) -> Bounded:
    if found.low is None or found.high is None:
        return Bounded(value=scale * found.value)
    return Bounded(value=scale * found.value, low=scale * found.low, high=scale * found.high)
