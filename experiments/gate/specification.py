"""What `gates.toml` may say of a scene: its kinds of gate and their tolerances."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from experiments.gate.scales import Scale

SMALL_EFFECT: Final[dict[Scale, float]] = {"ratio": 0.05, "error": 0.10, "similarity": 0.10}
"""Weakest fault that `noninferior` and `equal` must catch, relative. Energy x 1.05 is the fault
that the gate is named for; 10 % of a squared error is the same 5 % of its root."""
LARGE_EFFECT: Final[dict[Scale, float]] = {"ratio": 0.25, "error": 1.0, "similarity": 1.0}
"""Weakest fault that `absolute` must catch: a cap is the coarse net below the fine one, but an
error that doubles must not slip through it."""
SLOWDOWN: Final = 2.0
"""Weakest fault that `budget` must catch: a stage that takes twice its time."""

COUNTERPARTS: Final = {
    "dark_excess": "missing_energy",
    "leak": "missing_light",
    "leak_through": "missing_light",
    "leak_wrong_face": "missing_light",
}
"""What must be gated beside a measure of leaking: cones that see less also leak less."""

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


class Memory(Settings):
    """The voxels that cones read must not grow beyond the baseline's bytes x (1 + rel)."""

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
    samples_per_pixel: int | None = Field(default=None, ge=1)
    """Camera rays a pixel of the cones' picture; None for the preset's. Intervals hold the noise of
    the reference alone, so a tolerance near the scatter of the cones' own random numbers needs
    more rays than the preset has."""
    smallest_difference: float | None = Field(default=None, gt=0.0)
    """Smallest relMSE between picture and reference that the gate must be able to see; None for the
    one that the record finds. The reference's noise must lie ten times below it."""
    metrics: tuple[AnyMetricGate, ...] = Field(alias="metric", min_length=1, strict=False)
    budgets: tuple[Budget, ...] = Field(alias="budget", default=(), strict=False)
    memory: Memory | None = None
    deterministic: bool = False
    """Whether it is rendered twice, and both renders must have the same pictures bit for bit."""

    @model_validator(mode="after")
    def _each_once(self) -> GateSpec:
        names = [f"{gate.kind} {gate.metric} of {gate.component}" for gate in self.metrics]
        names += [f"budget of {budget.stage}" for budget in self.budgets]
        repeated = {name for name in names if names.count(name) > 1}
        if repeated:
            raise ValueError(f"gate {self.name!r} lists {min(repeated)} more than once")
        require_counterparts((gate.component, gate.metric) for gate in self.metrics)
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


def default_effect(gate: EffectGate) -> float:
    """Relative change by the weakest fault that every gate of this kind and scale must catch."""
    return (LARGE_EFFECT if isinstance(gate, Absolute) else SMALL_EFFECT)[gate.scale]


def weakest_effect(gate: EffectGate) -> float:
    """Relative change by the weakest fault that a gate must catch, unless `effect_abs` says it."""
    return default_effect(gate) if gate.effect is None else gate.effect


def require_counterparts(gated: Iterable[tuple[str, str]]) -> None:
    """Refuse a gate on leaking that has none on missing light beside it.

    Parameters
    ----------
    gated
        What the numbers are of, and their names.

    Raises
    ------
    ValueError
        The counterpart of a number is not gated.
    """
    found = set(gated)
    for subject, name in sorted(found):
        counterpart = COUNTERPARTS.get(name)
        if counterpart is not None and (subject, counterpart) not in found:
            raise ValueError(
                f"{name} of {subject} needs a gate on {counterpart} beside it: too much "
                "occlusion would pass as less leaking"
            )
