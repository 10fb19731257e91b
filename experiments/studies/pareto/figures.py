"""The chart of a scene: relMSE of indirect light and FLIP of the picture against device time."""

from __future__ import annotations

from experiments.clocks import REPETITIONS
from experiments.studies.check import Measured
from experiments.studies.figures import FigureShelf
from experiments.studies.pareto.bench import Bench, Result, has_denoiser
from experiments.studies.pareto.cone_frames import STILL
from experiments.studies.pareto.methods import DENOISED, FAMILIES, PATHS
from experiments.studies.pareto.trade_off import pareto_front
from reports.study_figures import Bounded, ScatterFigure, ScatterPanel, ScatterPoint

NO_DENOISER = " Denoised path tracing is left out: the extra [denoise] is not installed."


def draw(shelf: FigureShelf, bench: Bench) -> None:
    """Keep the chart of a scene."""
    results = sorted(bench.results.values(), key=lambda each: FAMILIES.index(each.method.family))
    shelf.add(
        ScatterFigure(
            group=bench.loaded.title,
            title="Error against time",
            caption="Still frames: the voxels are kept, so cones only gather; paths start anew. "
            f"Time: median and quartiles of {REPETITIONS} warm frames by the device's clock. Large "
            "marks are on the front, which nothing beats in both time and error."
            + ("" if has_denoiser() else NO_DENOISER),
            x_label="device time of a frame, ms",
            panels=[
                _panel("relMSE, indirect light", results, [each.score.relmse for each in results]),
                _panel("FLIP, whole picture", results, [each.score.flip for each in results]),
            ],
            joined=[PATHS, DENOISED],
        )
    )


def _panel(label: str, results: list[Result], errors: list[Measured]) -> ScatterPanel:
    times = [each.clocks[STILL].device() for each in results]
    front = pareto_front([each.value for each in times], [each.value for each in errors])
    return ScatterPanel(
        y_label=label,
        points=[
            ScatterPoint(
                name=result.method.name,
                family=result.method.family,
                x=_bounded(time, 1e3),
                y=_bounded(error),
                is_front=index in front,
            )
            for index, (result, time, error) in enumerate(zip(results, times, errors, strict=True))
        ],
    )


def _bounded(found: Measured, scale: float = 1.0) -> Bounded:
    if found.low is None or found.high is None:
        return Bounded(value=scale * found.value)
    return Bounded(value=scale * found.value, low=scale * found.low, high=scale * found.high)
