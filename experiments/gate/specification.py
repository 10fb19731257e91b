"""What `gates.toml` may say: which scenes are held to which kinds of gate and tolerances."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from experiments.errors import InputError
from experiments.gate.scales import Scale

SMALL_EFFECT: Final[dict[Scale, float]] = {"ratio": 0.05, "error": 0.10, "similarity": 0.10}
"""Weakest fault that `noninferior` and `equal` must catch, relative. Energy x 1.05 is the fault
that the gate is named for; 10 % of a squared error is the same 5 % of its root."""
LARGE_EFFECT: Final[dict[Scale, float]] = {"ratio": 0.25, "error": 1.0, "similarity": 1.0}
"""Weakest fault that `absolute` must catch: a cap is the coarse net below the fine one, but an
error that doubles must not slip through it."""
SLOWDOWN: Final = 2.0
"""Weakest fault that `budget` must catch: a stage that takes twice its time."""


Noise = Annotated[float | None, Field(ge=0.0, lt=1.0)]
"""Relative half-width for a metric that comes without interval, measured over seeds."""


class Settings(BaseModel):
    """Settings of every part: fixed after birth, exact types, no unknown key, finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MetricGate(Settings):
    """Which number a gate is about."""

    metric: str = Field(min_length=1)
    component: str = Field(min_length=1)


class Exact(MetricGate):
    """The same number, bit for bit: counts."""

    kind: Literal["exact"]


class EffectGate(MetricGate):
    """What the gates with a tolerance share: the scale, and the weakest fault to be caught."""

    scale: Scale = "error"
    effect: float | None = Field(default=None, gt=0.0)
    """Relative change by the weakest fault that this gate must catch; the default otherwise."""
    effect_abs: float | None = Field(default=None, gt=0.0)
    """The same as a distance (in the unit; natural logarithm for a ratio), for values near 0."""
    effect_from: str = ""
    """The fault and the command that measured the effect; needed unless it is under the default."""

    @model_validator(mode="after")
    def _effect_is_measured(self) -> Self:
        if self.effect is not None and self.effect_abs is not None:
            raise ValueError("give effect or effect_abs, not both")
        default = default_effect(self)
        is_larger = self.effect is not None and self.effect > default
        if (is_larger or self.effect_abs is not None) and not self.effect_from.strip():
            raise ValueError(
                "effect_from must say which mutant and which command measured the effect; "
                f"without it, the weakest mutant is a change of {default:g}"
            )
        return self


class Absolute(EffectGate):
    """The whole interval lies under `cap` (errors), over `low` (similarities) or between both."""

    kind: Literal["absolute"]
    noise: Noise = None
    cap: float | None = None
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _limits_fit_the_scale(self) -> Absolute:
        given = {name for name in ("cap", "low", "high") if getattr(self, name) is not None}
        needed = {"error": {"cap"}, "similarity": {"low"}, "ratio": {"low", "high"}}[self.scale]
        if given != needed:
            raise ValueError(
                f"an absolute gate on the scale {self.scale!r} needs {' and '.join(sorted(needed))}"
                f", got {', '.join(sorted(given)) or 'none'}"
            )
        if self.low is not None and self.high is not None and not 0.0 < self.low < self.high:
            raise ValueError(f"0 < low < high must hold, got low {self.low}, high {self.high}")
        return self


class NonInferior(EffectGate):
    """The upper bound stays under baseline x (1 + rel) + abs; a ratio stays within, either way."""

    kind: Literal["noninferior"]
    noise: Noise = None
    rel: float = Field(default=0.0, ge=0.0)
    abs: float = Field(default=0.0, ge=0.0)
    """In the metric's unit; for a ratio in its natural logarithm."""

    @model_validator(mode="after")
    def _narrower_than_its_mutant(self) -> NonInferior:
        if self.effect_abs is not None:
            is_wide = self.abs >= self.effect_abs
        elif self.scale == "ratio":
            is_wide = math.log1p(self.rel) + self.abs >= math.log1p(weakest_effect(self))
        else:
            is_wide = self.rel >= weakest_effect(self)
        if is_wide:
            raise ValueError(
                f"tolerance rel {self.rel:g}, abs {self.abs:g} is as wide as the effect of the "
                f"weakest mutant ({self.effect_abs or weakest_effect(self):g}), which would pass; "
                "narrow it"
            )
        return self


class Equal(EffectGate):
    """Nothing moved: a test of two intervals at `significance`, for path-traced parts only."""

    kind: Literal["equal"]
    significance: float = Field(default=0.001, gt=0.0, lt=0.5)
    """Share of false alarms that this gate may give; small, since a gate runs on each change."""


AnyMetricGate = Annotated[Absolute | NonInferior | Equal | Exact, Field(discriminator="kind")]


class Budget(Settings):
    """The stage's whole spread must not lie over the baseline's median x (1 + rel)."""

    stage: str = Field(min_length=1)
    rel: float = Field(ge=0.0, lt=SLOWDOWN - 1.0)


class GateSpec(Settings):
    """One scene, preset and resolution, and what it is held to.

    Finiteness of all pictures and identity of scene, configuration, resolution, scatterings and
    formulas are always checked and cannot be switched off.
    """

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")
    """Names the baseline file, so it is unique in `gates.toml`."""
    scene: str = Field(min_length=1)
    """A `SCENE` as the command line takes it."""
    preset: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")
    width: int = Field(ge=1)
    height: int = Field(ge=1)
    reference_spp: int = Field(ge=1)
    metrics: tuple[AnyMetricGate, ...] = Field(alias="metric", min_length=1, strict=False)
    budgets: tuple[Budget, ...] = Field(alias="budget", default=(), strict=False)

    @model_validator(mode="after")
    def _each_once(self) -> GateSpec:
        names = [f"{gate.kind} {gate.metric} of {gate.component}" for gate in self.metrics]
        names += [f"budget of {budget.stage}" for budget in self.budgets]
        repeated = {name for name in names if names.count(name) > 1}
        if repeated:
            raise ValueError(f"gate {self.name!r} lists {min(repeated)} more than once")
        return self


class Order(Settings):
    """A metamorphic gate over two others: `better` must not be worse than `worse`."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")
    better: str
    """Name of the gate whose record must have the smaller error."""
    worse: str
    metric: str = Field(min_length=1)
    component: str = Field(min_length=1)
    scale: Scale = "error"


class GatesFile(Settings):
    """All of `gates.toml`."""

    schema_version: Literal[1]
    baselines: str = "."
    """Folder of the baseline files, relative to the gates file."""
    gates: tuple[GateSpec, ...] = Field(alias="gate", min_length=1, strict=False)
    orders: tuple[Order, ...] = Field(alias="order", default=(), strict=False)

    @model_validator(mode="after")
    def _names_are_unique_and_known(self) -> GatesFile:
        names = [gate.name for gate in self.gates]
        everything = names + [order.name for order in self.orders]
        repeated = {name for name in everything if everything.count(name) > 1}
        if repeated:
            raise ValueError(f"the name {min(repeated)!r} is given more than once")
        for order in self.orders:
            unknown = {order.better, order.worse} - set(names)
            if unknown or order.better == order.worse:
                raise ValueError(
                    f"order {order.name!r} must name two different gates of {sorted(names)}, got "
                    f"better {order.better!r}, worse {order.worse!r}"
                )
        return self


def default_effect(gate: EffectGate) -> float:
    """Relative change by the weakest fault that every gate of this kind and scale must catch."""
    return (LARGE_EFFECT if isinstance(gate, Absolute) else SMALL_EFFECT)[gate.scale]


def weakest_effect(gate: EffectGate) -> float:
    """Relative change by the weakest fault that a gate must catch, unless `effect_abs` says it."""
    return default_effect(gate) if gate.effect is None else gate.effect


def load_gates(path: Path) -> GatesFile:
    """Read and check a `gates.toml`.

    Raises
    ------
    InputError
        When the file is missing, is not TOML, or has an unknown key, a wrong type, a tolerance
        wider than its mutant or a name twice; the message names the key.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"cannot read the gates file ({error.strerror})", str(path), "give the path of one"
        ) from error
    except ValueError as error:
        raise InputError(f"not TOML ({error})", str(path), "mend the line named") from error
    try:
        return GatesFile.model_validate(content)
    except ValidationError as error:
        raise InputError(
            _first_fault(error), str(path), "see experiments/gate/README.md for the keys"
        ) from error


def _first_fault(error: ValidationError) -> str:
    fault = error.errors(include_url=False)[0]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])
    message = "unknown key" if fault["type"] == "extra_forbidden" else fault["msg"]
    others = error.error_count() - 1
    return f"{key.lstrip('.') or 'the file'}: {message}" + (f" (+{others} more)" if others else "")
