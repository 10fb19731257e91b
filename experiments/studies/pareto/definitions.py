"""What the numbers of the study "pareto" are."""

from __future__ import annotations

from metrics.squared_error import RELMSE_E2_FORMULA
from reports.study_figures import Definition

_TRADE_OFF = "experiments/studies/pareto/trade_off.py"

DEFINITIONS = (
    Definition(
        name="relMSE",
        formula=f"{RELMSE_E2_FORMULA}; expected over the seeds of five frames",
        source="metrics/squared_error.py; interval: spread over seeds and noise of the reference",
    ),
    Definition(
        name="FLIP of the picture",
        formula="mean HDR-FLIP of indirect light with the reference's direct light and emission; "
        "one frame where a picture has more than 128 x 128 pixels, else three",
        source="metrics/perceptual.py; its lower end allows for FLIP between halves of the truth",
    ),
    Definition(
        name="device time",
        formula="sum of the run times of a frame's kernels; of denoised paths with the wall time "
        "of the denoiser, which runs on the CPU",
        source="experiments/clocks.py: dr.kernel_history, after two frames that "
        "compiled nothing; five frames of all methods in turns, each turn in another order. "
        "Methods that gather from the same lit voxels are one block; blocks are in random order",
    ),
    Definition(
        name="compile time",
        formula="wall time of the first frame less its device time: tracing of the code, and "
        "compiling of what no method before it, and no earlier run on the machine, had compiled",
        source="experiments/clocks.py",
    ),
    Definition(
        name="wall time",
        formula="from the call until the device has finished; a user waits for as long",
        source="experiments/clocks.py",
    ),
    Definition(
        name="moving camera, moving lights",
        formula="windows of the clipmap moved by two of the finest voxels, entered slabs "
        "voxelized, light maps, injection, downsampling, gathering; the same without "
        "voxelizing. The gathering is that of a still frame, what comes before it is timed apart, "
        'once for all methods that share voxels; whole frames of "high" say whether the sum is '
        "right. Paths start anew with every frame, so their time is that of a still frame",
        source="experiments/studies/pareto/cone_frames.py",
    ),
    Definition(
        name="slope",
        formula="of log relMSE over log samples a pixel, weighted least squares; -1 without bias",
        source=f"{_TRADE_OFF}, fit_slope; interval by Student's t",
    ),
    Definition(
        name="bias floor",
        formula='b^2 of relMSE = a / n + b^2 over n samples a pixel of "high"',
        source=f"{_TRADE_OFF}, fit_floor; interval by Student's t",
    ),
    Definition(
        name="time to its relMSE",
        formula="time at which the curve of paths, straight between its points in both logarithms, "
        "comes down to the preset's relMSE, over the preset's time; above 1 cones are faster",
        source=f"{_TRADE_OFF}, time_to_reach; interval by drawing errors and times from theirs: "
        "the range of five times is that of their median, by 94 %",
    ),
    Definition(
        name="relMSE in its time",
        formula="relMSE of the same curve at the preset's time, over the preset's; above 1 cones "
        "are more exact",
        source=f"{_TRADE_OFF}, error_at",
    ),
    Definition(
        name="front",
        formula="methods that no other beats in device time and relMSE both",
        source=f"{_TRADE_OFF}, pareto_front",
    ),
)
