"""What `gates.toml` may say of a study: which of its numbers are held to what, and their faults."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from experiments.gate.scales import Scale
from experiments.gate.specification import (
    Absolute,
    Exact,
    MetricGate,
    Noise,
    NonInferior,
    Settings,
    require_counterparts,
)


class OfStudy(MetricGate):
    """What gates on the numbers of a study share.

    `noise` replaces the interval of the study: that one is over phases of the lattice or tiles of
    a picture, which are the same whenever the number is measured.
    """

    model_config = ConfigDict(populate_by_name=True)

    metric: str = Field(alias="check", min_length=1)
    """Name of a check of the study."""
    component: Literal["the study"] = "the study"
    mutant: str = Field(min_length=1)
    """Name of the check that measures the same with a planted fault; the gate must fail on it."""

    @model_validator(mode="after")
    def _is_another_number(self) -> Self:
        if self.mutant == self.metric:
            raise ValueError(f"the mutant of {self.metric!r} must be another check of the study")
        return self


class StudyAbsolute(OfStudy, Absolute):
    """`absolute` on a number of a study."""


class StudyNonInferior(OfStudy, NonInferior):
    """`noninferior` on a number of a study."""


class StudyExact(OfStudy, Exact):
    """`exact` on a number of a study: the baseline's, bit for bit, such as a count of 0."""


AnyStudyGate = Annotated[StudyAbsolute | StudyNonInferior | StudyExact, Field(discriminator="kind")]


class StudyOrder(Settings):
    """A metamorphic gate over two numbers of a study: `better` must lie below `worse`."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")
    better: str = Field(min_length=1)
    worse: str = Field(min_length=1)
    scale: Scale = "error"
    noise: Noise = None
    """As for the other kinds; None takes the intervals of the study."""

    @model_validator(mode="after")
    def _are_two(self) -> Self:
        if self.better == self.worse:
            raise ValueError(f"order {self.name!r} must name two different checks")
        return self


class StudyGate(Settings):
    """A study, and what its numbers are held to.

    That all numbers are finite, and measured with the same configuration of the same scene, is
    always checked.
    """

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")
    """Names the baseline file, so it is unique in `gates.toml`."""
    study: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")
    """As `vctgi study` names it."""
    quick: bool = True
    """Whether the smaller version of the study is measured."""
    checks: tuple[AnyStudyGate, ...] = Field(alias="check", min_length=1, strict=False)
    orders: tuple[StudyOrder, ...] = Field(alias="order", default=(), strict=False)

    @property
    def scene(self) -> str:
        """What a verdict is filed under."""
        return f"study {self.study}"

    @property
    def needed(self) -> list[str]:
        """Checks that are measured, each once."""
        names = [gate.metric for gate in self.checks]
        names += [each for order in self.orders for each in (order.better, order.worse)]
        return list(dict.fromkeys(names))

    @property
    def planted(self) -> list[str]:
        """Checks that are measured with the mutants besides, each once."""
        wanted = dict.fromkeys(gate.mutant for gate in self.checks)
        return [name for name in wanted if name not in self.needed]

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        names = [f"{gate.kind} {gate.metric}" for gate in self.checks]
        names += [f"order {order.name}" for order in self.orders]
        repeated = {name for name in names if names.count(name) > 1}
        if repeated:
            raise ValueError(f"study {self.name!r} lists {min(repeated)} more than once")
        require_counterparts(_subject_and_name(gate.metric) for gate in self.checks)
        return self


def _subject_and_name(check: str) -> tuple[str, str]:
    """Part "sealed_rooms, audit, leak" into what it is of, and the number."""
    subject, _, name = check.rpartition(", ")
    return subject, name
