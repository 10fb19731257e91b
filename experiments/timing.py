"""Times of the pipeline's stages over repeated frames.

A stage ends when the device has finished it, so its time holds the work and the launch, but not
the waiting of a later stage. The first frame also compiles its kernels; it is reported apart.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager

import drjit as dr

from reports.record import StageTime

FRAME = "frame"
"""Name of the sum over all stages."""


class StageTimer:
    """A clock for `vctgi.pipeline` that keeps the times of every frame."""

    def __init__(self) -> None:
        self._frames: list[dict[str, float]] = []

    def start_frame(self) -> None:
        """Begin a new frame; what is timed from now on belongs to it."""
        self._frames.append({})

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a stage of the current frame; stages of one name add up."""
        dr.sync_thread()
        start = time.perf_counter()
        yield
        dr.sync_thread()
        frame = self._frames[-1]
        frame[stage] = frame.get(stage, 0.0) + time.perf_counter() - start

    def stage_times(self) -> list[StageTime]:
        """Median and range of each stage over the warm frames, then of the whole frame.

        Raises
        ------
        ValueError
            Fewer than two frames: the first one only warms up.
        """
        if len(self._frames) < 2:
            raise ValueError("StageTimer.stage_times: time at least two frames, the first warms up")
        cold, *warm = self._frames
        times = [_spread(stage, [frame[stage] for frame in warm]) for stage in warm[0]]
        whole = [sum(frame.values()) for frame in warm]
        note = f"first frame, with compilation: {1e3 * sum(cold.values()):.0f} ms"
        return [*times, _spread(FRAME, whole, note)]


def _spread(stage: str, seconds: list[float], note: str = "") -> StageTime:
    return StageTime(
        stage=stage,
        median_ms=1e3 * statistics.median(seconds),
        low_ms=1e3 * min(seconds),
        high_ms=1e3 * max(seconds),
        count=len(seconds),
        note=note,
    )
