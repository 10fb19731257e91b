"""The baseline of a gate: what a reviewed record measured, one JSON file in git."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import Field, JsonValue, ValidationError, model_validator

from experiments.errors import InputError
from experiments.gate.scales import Estimate, estimate_from_bounds
from experiments.gate.specification import AnyMetricGate, EffectGate, GateSpec, Settings
from reports.record import Display, Machine, Record

Model = TypeVar("Model", bound=Settings)


class BaselineMetric(Settings):
    """One number with its interval (in the metric's unit), its formula and its tolerance."""

    value: float
    low: float
    high: float
    level: float = Field(gt=0.0, lt=1.0)
    """Confidence level of the interval."""
    formula: str
    tolerance: AnyMetricGate
    """The gate as it stood in `gates.toml` when this baseline was reviewed."""

    @model_validator(mode="after")
    def _value_in_interval(self) -> BaselineMetric:
        if not self.low <= self.value <= self.high:
            raise ValueError(f"low {self.low} <= value {self.value} <= high {self.high} must hold")
        return self

    def estimate(self) -> Estimate:
        """Put the number on the axis of its gate's scale."""
        gate = self.tolerance
        scale = gate.scale if isinstance(gate, EffectGate) else "error"
        where = f"baseline of {gate.metric} of {gate.component}"
        return estimate_from_bounds(scale, self.value, self.low, self.high, where)


class BaselineTime(Settings):
    """Time of one stage, milliseconds."""

    stage: str
    median_ms: float = Field(ge=0.0)
    low_ms: float = Field(ge=0.0)
    high_ms: float = Field(ge=0.0)


class ReferenceStamp(Settings):
    """Which reference the numbers were measured against."""

    key: str
    samples_per_pixel: int = Field(ge=1)
    batch_count: int = Field(ge=1)
    scattering_count: int = Field(ge=0)
    seed: int


class Environment(Settings):
    """The fingerprint of the machine and the software."""

    backend: str
    device: str
    processor: str
    core_count: int = Field(ge=1)
    system: str
    python: str
    versions: dict[str, str]

    def different_machine(self, other: Environment) -> tuple[str, ...]:
        """Say what makes times of the two not comparable: backend, device, processor, cores."""
        fields = ("backend", "device", "processor", "core_count")
        return tuple(
            f"{name} {getattr(other, name)} (baseline {getattr(self, name)})"
            for name in fields
            if getattr(self, name) != getattr(other, name)
        )


class Baseline(Settings):
    """Everything that a later record of the same gate is compared with."""

    schema_version: Literal[1] = 1
    gate: str
    scene: str
    preset: str
    backend: str
    method: str
    reason: str = Field(min_length=1)
    """Why these numbers are right, as given to the update."""
    created: str
    """Time of the record, ISO 8601 UTC."""
    commit: str
    is_dirty: bool
    scene_digest: str
    config_hash: str
    width: int
    height: int
    metrics: list[BaselineMetric]
    times: list[BaselineTime]
    voxel_bytes: int | None = None
    """Size of the voxels that cones read; None where no gate asks for it."""
    display: Display
    """Brightness and FLIP exposures that the numbers were measured with."""
    environment: Environment
    reference: ReferenceStamp | None

    def metric_for(self, gate: AnyMetricGate) -> BaselineMetric | None:
        """Find the stored number of a metric's gate, by kind, metric and component."""
        key = (gate.kind, gate.metric, gate.component)
        for entry in self.metrics:
            stored = entry.tolerance
            if (stored.kind, stored.metric, stored.component) == key:
                return entry
        return None


def config_hash(config: dict[str, JsonValue]) -> str:
    """SHA-256 of a record's configuration as canonical JSON: sorted keys, no spaces."""
    text = json.dumps(config, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def environment_of(machine: Machine) -> Environment:
    """Take the fingerprint from a record's machine."""
    return Environment(
        backend=machine.backend,
        device=machine.device,
        processor=machine.processor,
        core_count=machine.core_count,
        system=machine.system,
        python=machine.python,
        versions=machine.versions,
    )


def reference_of(record: Record) -> ReferenceStamp | None:
    """Take from a record which reference it was measured against."""
    if record.reference is None:
        return None
    return ReferenceStamp(
        key=record.reference.key,
        samples_per_pixel=record.reference.samples_per_pixel,
        batch_count=record.reference.batch_count,
        scattering_count=record.reference.scattering_count,
        seed=record.reference.seed,
    )


def baseline_path(folder: Path, gate: GateSpec, backend: str) -> Path:
    """`<folder>/<gate>.<preset>.<backend>.json`: one file per scene, preset and back end."""
    return folder / f"{gate.name}.{gate.preset}.{backend}.json"


def read_baseline(path: Path) -> Baseline | None:
    """Read a baseline; None when there is no such file.

    Raises
    ------
    InputError
        When the file cannot be read or is not a baseline of this schema.
    """
    return read_model(path, Baseline)


def read_model(path: Path, model: type[Model]) -> Model | None:
    """Read a file of one of the forms that baselines have; see `read_baseline`."""
    remedy = "take the file from git, or review a new one made by --update --reason TEXT"
    try:
        return model.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(
            f"cannot read the baseline ({error.strerror})", str(path), remedy
        ) from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or "the file"
        raise InputError(f"broken baseline: {key}: {first['msg']}", str(path), remedy) from error


def pinned_display(folder: Path, gate: GateSpec, backend: str) -> Display | None:
    """Return the display of a gate's baseline, for a render to measure with; None without one.

    Raises
    ------
    InputError
        When the baseline is broken.
    """
    baseline = read_baseline(baseline_path(folder, gate, backend))
    return None if baseline is None else baseline.display
