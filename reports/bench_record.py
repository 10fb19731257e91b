"""The record of a benchmark: times, which depend on the machine, and counts, which do not."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from reports.model_file import read_model
from reports.schema import Machine

BENCH_SCHEMA_VERSION: Final = 1
"""Raised by one whenever a reader of the old form would misread the new one."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Rates(_Part):
    """What the machine reached in the same run, doing nothing else."""

    coherent_reads: float = Field(gt=0.0)
    random_reads: float = Field(gt=0.0)
    """Texels of the volume a second, read by neighbouring lanes from neighbouring places, or from
    anywhere."""
    copied_bytes: float = Field(gt=0.0)
    """Bytes a second, read and written."""


class Spread(_Part):
    """A time over frames, ms."""

    median: float = Field(ge=0.0)
    low: float = Field(ge=0.0)
    high: float = Field(ge=0.0)
    """Quartiles."""
    worst: float = Field(ge=0.0)


class StageCounts(_Part):
    """What a stage did in one frame, which does not depend on the machine."""

    launches: int = Field(ge=0)
    """Of kernels, and of what Dr.Jit brings ready made, such as sums."""
    operations: int = Field(ge=0)
    """Operations in the kernels' code, those of loops once."""
    lane_operations: int = Field(ge=0)
    """The same, times lanes."""
    texel_reads: int = Field(ge=0)
    """Texels of the volume that cones and near-field rays read, where the stage does."""
    bytes: int = Field(ge=0)
    """What the stage must read and write at least, apart from those texels."""


class StageResult(_Part):
    """A stage: how long it took, and how long it would at the machine's rates."""

    stage: str
    device_ms: Spread
    counts: StageCounts
    floor_ms: float = Field(ge=0.0)
    """Texels over the rate of coherent reads, and bytes over the rate of copying."""


class FrameResult(_Part):
    """Frames of one kind."""

    kind: str
    frame_count: int = Field(ge=1)
    device_ms: Spread
    """All of indirect light: not primary visibility and what moves camera or
    lights, which `application_ms` has."""
    worst_frame: int = Field(ge=0)
    application_ms: float = Field(ge=0.0)
    wall_ms: float = Field(ge=0.0)
    """Of a frame with a cache of what it traces, from an idle device to an idle device; nothing
    watches, median."""
    host_ms: float = Field(ge=0.0)
    """Wall time less the run time of all kernels of such a frame: what the host adds."""
    loop_ms: float | None = Field(default=None, ge=0.0)
    """Of a frame in a loop that waits for nothing, mean, with what moves camera or lights."""
    compiled: int = Field(ge=0)
    """Kernels that were not in memory yet, in all frames that count."""
    stages: list[StageResult]


class FirstFrame(_Part):
    """A process of its own, from its start to the end of its second frame, seconds."""

    cache: Literal["cold", "kept"]
    """Of kernels."""
    import_s: float = Field(ge=0.0)
    load_s: float = Field(ge=0.0)
    prepare_s: float = Field(ge=0.0)
    first_frame_s: float = Field(ge=0.0)
    """Voxels, light and picture."""
    second_frame_s: float = Field(ge=0.0)
    codegen_s: float = Field(ge=0.0)
    backend_s: float = Field(ge=0.0)
    """Of all kernels: writing their code, and compiling it."""
    kernels: int = Field(ge=0)
    compiled: int = Field(ge=0)
    """Different kernels, and those of them that no cache had."""


class ConeCounts(_Part):
    """What the cones of a still frame did."""

    gathering_cones: int = Field(ge=0)
    gathering_samples: int = Field(ge=0)
    specular_cones: int = Field(ge=0)
    specular_samples: int = Field(ge=0)
    rays: int = Field(ge=0)
    """Of the near field."""
    volume_bytes: int = Field(ge=0)


class PresetResult(_Part):
    """One preset."""

    preset: str
    configuration: str
    cones: ConeCounts
    rates: Rates
    """Of its own volume."""
    frames: list[FrameResult]
    first_frames: list[FirstFrame] = []
    talk_ms: float | None = None
    scaled_ms: float | None = None
    goal_ms: float | None = None
    """Of the talk, the same scaled to this project's GPU by texture rate, and the goal."""


class BenchRecord(_Part):
    """One run of `vctgi bench`."""

    schema_version: Literal[1] = BENCH_SCHEMA_VERSION
    created: AwareDatetime
    command: str
    scene: str
    width: int = Field(ge=1)
    height: int = Field(ge=1)
    machine: Machine
    presets: list[PresetResult]


def bench_text(record: BenchRecord) -> str:
    """Return what the file of a record holds."""
    return record.model_dump_json(indent=1) + "\n"


def read_bench(path: Path) -> BenchRecord:
    """Read the file of a benchmark.

    Raises
    ------
    ValueError
        When the file is missing or is not the record of a benchmark.
    """
    return read_model(
        path, BenchRecord, noun="record", kind="benchmark", command="vctgi bench --json FILE"
    )
