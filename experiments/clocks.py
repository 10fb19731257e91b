"""Three clocks: what the device worked, what compiling took, and what a user waited for.

A frame is warm when two launches before it compiled nothing; repetitions of all methods are mixed
at random, so that no drift of the machine falls on one of them alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import drjit as dr
import numpy as np

from experiments.studies.check import Measured

REPETITIONS: Final = 5
"""Warm frames that are timed, at least."""
WARM_FRAMES: Final = 2
"""Frames after the last one that compiled, before the first that is timed."""
MOST_FRAMES: Final = 8
"""Frames that are tried until nothing is compiled any more."""

Render = Callable[[int], object]
"""Renders a frame with a seed, until the device is asked for all of it; what it returns may hold
``host_seconds``, the time of work that is not the device's."""


class NeverWarmError(RuntimeError):
    """A method compiles in every frame."""


@dataclass(frozen=True)
class FrameTime:
    """One frame.

    Attributes
    ----------
    device
        Run time of its kernels, and of work outside of them that it needs, seconds.
    wall
        Until the device had finished, seconds.
    compiled
        Kernels that were not in memory yet, but compiled or read from disk.
    """

    device: float
    wall: float
    compiled: int


@dataclass
class Clocks:
    """Times of one method's frames.

    Attributes
    ----------
    compile
        Wall time of the first frame less the device's: tracing, and compiling of what no earlier
        method had compiled, seconds.
    warm
        Frames that count.
    """

    compile: float
    warm: list[FrameTime] = field(default_factory=list)

    def __add__(self, other: Clocks) -> Clocks:
        """Return the times of frames that are made of two parts, timed apart, turn by turn."""
        return Clocks(
            self.compile + other.compile,
            [
                FrameTime(a.device + b.device, a.wall + b.wall, a.compiled + b.compiled)
                for a, b in zip(self.warm, other.warm, strict=True)
            ],
        )

    def device(self) -> Measured:
        """Return median and quartiles, seconds."""
        return median_of([each.device for each in self.warm])

    def device_median(self) -> Measured:
        """Return the median and the range, seconds: that of five holds the true median by 94 %."""
        times = [each.device for each in self.warm]
        return Measured(value=self.device().value, low=min(times), high=max(times))

    def wall(self) -> Measured:
        """Return median and quartiles, seconds."""
        return median_of([each.wall for each in self.warm])


@dataclass
class Job:
    """What is timed, and what its frames gave.

    Attributes
    ----------
    name
        Of the method.
    render
        Makes a frame.
    keep
        Takes what each timed frame returned, outside of the clock.
    clocks
        Filled by `time_jobs`.
    warm_up
        Makes a shorter frame by the same kernels, which warms them as well; None: `render`.
    """

    name: str
    render: Render
    keep: Callable[[object], None] = lambda _: None
    clocks: Clocks = field(default_factory=lambda: Clocks(0.0))
    warm_up: Render | None = None


def timed_frame(render: Render, seed: int) -> tuple[FrameTime, object]:
    """Render one frame under all clocks."""
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        start = time.perf_counter()
        found = render(seed)
        dr.sync_thread()
        wall = time.perf_counter() - start
        kernels = dr.kernel_history()
    device = sum(kernel["execution_time"] for kernel in kernels) / 1e3
    compiled = sum(is_new(kernel) for kernel in kernels)
    return FrameTime(device + getattr(found, "host_seconds", 0.0), wall, compiled), found


def is_new(kernel: dict[str, Any]) -> bool:
    """Whether an entry of the history was not in memory yet, but compiled or read from disk.

    Entries that are not traced code, such as sums, have no say in compiling.
    """
    return not kernel.get("cache_hit", True) or bool(kernel.get("cache_disk", False))


def time_jobs(
    jobs: Sequence[Job],
    random: np.random.Generator,
    repetitions: int = REPETITIONS,
    progress: Callable[[float], None] = lambda _: None,
) -> None:
    """Warm all jobs up, then time them in turns, each turn in an order of its own.

    Raises
    ------
    NeverWarmError
        A job compiles in every frame, so that none of them is warm.
    """
    total = len(jobs) * (1 + repetitions)
    for done, index in enumerate(random.permutation(len(jobs))):
        _warm_up(jobs[index])
        progress(done / total)
    for turn in range(repetitions):
        for place, index in enumerate(random.permutation(len(jobs))):
            job = jobs[index]
            frame, found = timed_frame(job.render, MOST_FRAMES + turn)
            job.keep(found)
            job.clocks.warm.append(frame)
            progress((len(jobs) * (1 + turn) + place) / total)


def _warm_up(job: Job) -> None:
    warm = 0
    for number in range(MOST_FRAMES):
        frame, _ = timed_frame(job.warm_up or job.render, number)
        if number == 0:
            job.clocks = Clocks(max(frame.wall - frame.device, 0.0))
        warm = 0 if frame.compiled else warm + 1
        if warm == WARM_FRAMES:
            return
    raise NeverWarmError(
        f"no frame of {job.name} is warm: {MOST_FRAMES} in a row compiled kernels; a number that "
        "changes from frame to frame is part of their code and must be opaque."
    )


def median_of(values: Sequence[float]) -> Measured:
    """Return median and quartiles."""
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    return Measured(value=float(middle), low=float(low), high=float(high))
