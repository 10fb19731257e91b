"""Which kernels each stage of a frame launched: their device time, and how much they are.

A kernel belongs to the stage that launches it; what waits unevaluated when a stage ends counts for
the one that needs it. Reading the history makes the host wait, so that wall times of such a frame
say nothing; the device's do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import drjit as dr

from experiments.clocks import is_new

APPLICATION, VOXELS, INJECTION, DOWNSAMPLING, TRACING, INTERPOLATION, SPECULAR, COMPOSITE = (
    "application",
    "voxel update",
    "injection",
    "downsampling",
    "tracing",
    "interpolation",
    "specular + filter",
    "composite",
)
"""Stages of a benchmark's table. The first is no part of indirect light: primary visibility, and
moving camera and lights."""

STAGES = (VOXELS, INJECTION, DOWNSAMPLING, TRACING, INTERPOLATION, SPECULAR, COMPOSITE)

STAGE_OF = {
    "scene change": APPLICATION,
    "G-buffer": APPLICATION,
    "opacity voxelization": VOXELS,
    "emittance voxelization": VOXELS,
    "downsampling": DOWNSAMPLING,
    "diffuse cones": TRACING,
    "ambient cones": TRACING,
    "interpolation": INTERPOLATION,
    "specular cones": SPECULAR,
    "composite": COMPOSITE,
    "": COMPOSITE,
}
"""Stages of the pipeline's clock; those of light that are not named here are `INJECTION`. What is
outside of all puts the picture together."""


@dataclass
class Work:
    """What a stage launched in a frame.

    Attributes
    ----------
    device
        Run time of the kernels, seconds.
    launches, operations, lane_operations
        As `reports.bench_record.StageCounts` has them.
    compiled
        Kernels that were not in memory yet.
    reads
        Texels that were read, where they are counted.
    """

    device: float = 0.0
    launches: int = 0
    operations: int = 0
    lane_operations: int = 0
    compiled: int = 0
    reads: int = 0


class KernelClock:
    """A clock for `vctgi.pipeline` that parts the history of kernels by stage.

    Parameters
    ----------
    count_reads
        Returns how many texels were read since it was asked last; left out, none.
    """

    def __init__(self, count_reads: Callable[[], int] | None = None) -> None:
        self.frame: dict[str, Work] = {}
        self._count_reads = count_reads
        self._open: list[str] = []

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Note what is launched until the end of the context under the stage."""
        self._note()
        self._open.append(stage)
        try:
            yield
            self._note()
        finally:
            self._open.pop()

    @contextmanager
    def watched(self) -> Iterator[dict[str, Work]]:
        """Note the work of one frame, by stage."""
        self.frame = {}
        dr.sync_thread()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            yield self.frame
            self._note()

    def _note(self) -> None:
        """Add what has been launched since the last call to the stage that is open."""
        name = self._open[-1] if self._open else ""
        stage = STAGE_OF.get(name, INJECTION)
        kernels = dr.kernel_history()
        reads = 0 if self._count_reads is None else self._count_reads()
        if not kernels and not reads:
            return
        work = self.frame.setdefault(stage, Work())
        work.reads += reads
        for kernel in kernels:
            operations = int(kernel.get("operation_count", 0))
            work.device += kernel["execution_time"] / 1e3
            work.launches += 1
            work.operations += operations
            work.lane_operations += operations * int(kernel.get("size", 0))
            work.compiled += is_new(kernel)
