"""The schema of a record: everything that is kept of one run, and the only source of a report."""

from __future__ import annotations

import math
import re
from datetime import datetime, timedelta
from pathlib import PurePosixPath
from typing import Annotated, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    JsonValue,
    model_validator,
)

SCHEMA_VERSION: Final = 1
"""Raised by one whenever a reader of the old form would misread the new one."""

RECORD_ID_FORM = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,199}")
SHA256_FORM = re.compile(r"[0-9a-f]{64}")

Point = tuple[float, float, float]


def _checked_record_id(value: str) -> str:
    if RECORD_ID_FORM.fullmatch(value) is None:
        raise ValueError(
            f"record_id {value!r} must name a file: letters, digits, '.', '_' and '-', starting "
            "with a letter or digit, at most 200"
        )
    return value


def _checked_sha256(value: str) -> str:
    if SHA256_FORM.fullmatch(value) is None:
        raise ValueError(f"sha256 must be 64 lower-case hexadecimal digits, got {value!r}")
    return value


def _checked_relative_path(value: str) -> str:
    path = PurePosixPath(value)
    if not path.parts or path.is_absolute() or ".." in path.parts or "\\" in value:
        raise ValueError(
            f"image path {value!r} must be relative to the record's folder, stay inside it, "
            "and use '/'"
        )
    return value


def _checked_utc_time(value: str) -> str:
    moment = datetime.fromisoformat(value)
    if moment.utcoffset() != timedelta(0):
        raise ValueError(f"created must be an ISO 8601 time in UTC ('...+00:00'), got {value!r}")
    return value


def _plain_json(value: object, where: str = "config") -> object:
    """Tuples become lists, so that a record equals what is read back; NaN has no JSON form."""
    if isinstance(value, dict):
        return {key: _plain_json(part, f"{where}.{key}") for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain_json(part, f"{where}[{index}]") for index, part in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{where} is {value}: a record holds finite numbers only")
    return value


class _Part(BaseModel):
    """Settings of every part of a record: fixed after birth, no unknown field, finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Interval(_Part):
    """A confidence interval."""

    low: float
    high: float
    level: float = Field(default=0.95, gt=0.0, lt=1.0)
    """Share of repetitions whose interval holds the true value."""

    @model_validator(mode="after")
    def _ordered(self) -> Interval:
        if self.low > self.high:
            raise ValueError(f"interval low {self.low} must not exceed high {self.high}")
        return self


class MetricValue(_Part):
    """One number about one component of the picture."""

    name: str
    component: str
    """What was compared: `image`, `indirect`, `indirect_diffuse` or `indirect_specular`."""
    value: float
    interval: Interval | None
    formula: str
    unit: str = ""
    ideal: float
    """Value of a perfect picture: 0 for errors, 1 for ratios and SSIM."""
    note: str = ""


class StageTime(_Part):
    """Time of one stage of the pipeline over repeated frames, milliseconds."""

    stage: str
    median_ms: float = Field(ge=0.0)
    low_ms: float = Field(ge=0.0)
    high_ms: float = Field(ge=0.0)
    count: int = Field(ge=1)
    note: str = ""

    @model_validator(mode="after")
    def _ordered(self) -> StageTime:
        if not self.low_ms <= self.median_ms <= self.high_ms:
            raise ValueError(
                f"stage {self.stage!r}: low_ms {self.low_ms} <= median_ms {self.median_ms} <= "
                f"high_ms {self.high_ms} must hold"
            )
        return self


class FrameCost(_Part):
    """What the cones of one frame read, counted in a frame of its own that is not timed."""

    gathering_cones: int = Field(ge=0)
    """Diffuse cones that marched, or those of ambient occlusion."""
    gathering_samples: int = Field(ge=0)
    """Steps that they took; each is one sample of the voxels, between two levels."""
    specular_cones: int = Field(ge=0)
    specular_samples: int = Field(ge=0)
    near_field_rays: int = Field(ge=0)
    """Real rays in place of the beginning of cones."""
    voxel_bytes: int = Field(ge=0)
    """Size of the voxels that are read."""

    @property
    def samples(self) -> int:
        """Samples of the voxels by all cones."""
        return self.gathering_samples + self.specular_samples


class ImageFile(_Part):
    """An EXR picture (float32, channels R G B or Y) that belongs to a record."""

    path: Annotated[str, AfterValidator(_checked_relative_path)]
    """Relative to the folder of the record file."""
    sha256: Annotated[str, AfterValidator(_checked_sha256)]
    description: str = ""


class PlanEntry(_Part):
    """A stage, level, light or texture that the plan kept or left out."""

    item: str
    kept: bool
    reason: str
    saved: str = ""
    bound: str = ""
    """How far leaving it out moves the picture: "bit for bit", or a proved bound."""
    override: str = ""
    """What keeps it: an option of the command line, or a field of the configuration."""


class SceneInfo(_Part):
    """The scene as it was rendered; `bounds` in world units."""

    name: str
    title: str
    source: str
    purpose: str
    digest: str
    triangle_count: int = Field(ge=0)
    emitters: dict[str, int]
    """How many of each emitter type."""
    bsdfs: dict[str, int]
    """How many of each BSDF type."""
    bounds_min: Point
    bounds_max: Point
    contributions: list[str]
    """What each material adds to the indirect light."""
    unsupported: list[str]
    credit: str = ""


class NoiseFloor(_Part):
    """How noisy the mean of a reference's batches is, as a relMSE."""

    value: float
    upper: float
    """One-sided 95 % bound."""


class ReferenceInfo(_Part):
    """The path-traced reference."""

    key: str
    samples_per_pixel: int = Field(ge=1)
    batch_count: int = Field(ge=1)
    scattering_count: int = Field(ge=0)
    """Surface scatterings between emitter and eye, the same on both sides."""
    seed: int
    seconds: float = Field(ge=0.0)
    """Time that the reference took when it was rendered, also when it came from the cache."""
    from_cache: bool
    noise_relmse: float | None
    """Estimated relative MSE of the reference's mean indirect light, unbiased and so not always
    positive; None where there is none."""
    noise_floors: dict[str, NoiseFloor] = {}
    """By component, of those that hold light; empty in records from before it was kept. The noise
    of direct light and emission is on both sides, so "image" does not count it."""
    truncated_share: float
    """Energy of more scatterings than `scattering_count`, over all reflected energy."""
    notes: list[str] = []
    """What a reader of the reference should know: components that are exactly zero, conventions."""


class Machine(_Part):
    """What the run was made on and with."""

    backend: Literal["llvm_ad_rgb", "cuda_ad_rgb"]
    device: str
    processor: str
    core_count: int = Field(ge=1)
    memory_gib: float = Field(ge=0.0)
    system: str
    python: str
    versions: dict[str, str]
    commit: str
    is_dirty: bool


class Display(_Part):
    """How linear radiance was mapped to something seen."""

    nits_per_unit: float = Field(gt=0.0)
    exposure: float
    """Stops, for the tone-mapped pictures."""
    flip_start_exposure: float
    flip_stop_exposure: float
    flip_exposure_count: int = Field(ge=1)
    flip_pixels_per_degree: float = Field(gt=0.0)


class Record(_Part):
    """One run: one scene, one method, one preset, one seed."""

    schema_version: Literal[1] = SCHEMA_VERSION
    record_id: Annotated[str, AfterValidator(_checked_record_id)]
    created: Annotated[str, AfterValidator(_checked_utc_time)]
    """ISO 8601 in UTC, such as `2026-01-31T12:00:00+00:00`."""
    command: str
    """What to type to make this record again."""
    scene: SceneInfo
    method: str
    preset: str
    config: Annotated[dict[str, JsonValue], BeforeValidator(_plain_json)]
    plan: list[PlanEntry]
    seed: int
    width: int = Field(ge=1)
    height: int = Field(ge=1)
    reference: ReferenceInfo | None
    metrics: list[MetricValue]
    times: list[StageTime]
    cost: FrameCost | None = None
    """What a frame read; None where it was not counted."""
    images: dict[str, ImageFile]
    machine: Machine
    display: Display
    warnings: list[str]
