"""What a frame takes of a user's time, with a cache of what it traces, as an application renders.

Two clocks: of single frames, each from an idle device to an idle device, and of a loop that waits
for nothing, where the host may run ahead of the device. What moves camera or lights is the
application's, and so is not in the first; a loop cannot do without it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import count
from typing import Final

import drjit as dr
import numpy as np

from experiments.bench.walks import Walk
from experiments.clocks import MOST_FRAMES
from vctgi.trace_cache import TraceCache

WALL_FRAMES: Final = 16
"""Frames of each clock. Their median counts: some begin with another number of lanes than any frame
before, and are recorded anew."""

RECORDING_FRAMES: Final = 4
"""Frames before them: the first makes tables, the second is recorded, and what moves for the first
time is a constant of kernels no more."""


@dataclass(frozen=True)
class WallTimes:
    """Seconds of a frame.

    Attributes
    ----------
    frame
        From an idle device until it is idle again, median.
    device
        Run time of the kernels of such a frame, median.
    loop
        Mean over frames one after the other, with what moves camera or lights.
    """

    frame: float
    device: float
    loop: float


def wall_times(walk: Walk, seconds: float) -> WallTimes:
    """Time frames that no earlier one was like: what is compiled for each frame anew shows."""
    walk.cache = TraceCache()
    numbers = count(MOST_FRAMES)
    for _ in range(RECORDING_FRAMES):
        walk.frame(next(numbers))
    frames: list[float] = []
    while not frames or (len(frames) < WALL_FRAMES and sum(frames) < seconds):
        number = next(numbers)
        walk.change(number)
        dr.sync_thread()
        start = time.perf_counter()
        walk.render(number)
        dr.sync_thread()
        frames.append(time.perf_counter() - start)
    start = time.perf_counter()
    for _ in frames:
        walk.frame(next(numbers))
    dr.sync_thread()
    loop = (time.perf_counter() - start) / len(frames)
    devices = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        # A recording under another flag is another one.
        for place in range(RECORDING_FRAMES + len(frames)):
            number = next(numbers)
            walk.change(number)
            dr.kernel_history_clear()
            walk.render(number)
            dr.sync_thread()
            found = sum(kernel["execution_time"] for kernel in dr.kernel_history()) / 1e3
            if place >= RECORDING_FRAMES:
                devices.append(found)
    walk.cache = None
    return WallTimes(float(np.median(frames)), float(np.median(devices)), loop)
