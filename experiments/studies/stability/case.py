"""One stiff or extreme case as data, and the one loop that runs all of them."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext

Limits = tuple[float | None, float | None]

EXACT: Limits = (0.0, 0.0)
"""Of what must be 0 to the last bit."""

REFUSED = "refused in one line"
"""Number of cases that must not be rendered: 1 if the renderer says why, 0 if it renders."""

UNSOUND = "values that are NaN, infinite or negative"
"""Number of every case that makes pictures."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What running a case gave.

    Attributes
    ----------
    pictures
        All light that it made, any shape; searched for what is no light.
    numbers
        The numbers that the case has limits for, by name.
    """

    pictures: Sequence[np.ndarray] = ()
    numbers: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class StabilityCase:
    """A stiff or extreme case.

    Attributes
    ----------
    name
        Unique within the study.
    expected, why
        What must come out, and the reason for it.
    run
        Runs it.
    limits
        What each number must keep to, by the number's name.
    goals
        What one would like to see.
    in_quick
        Whether the quick version of the study runs it.
    is_sound
        Whether it makes pictures, which are then searched for what is no light.
    """

    name: str
    expected: str
    why: str
    run: Callable[[StudyContext], Outcome]
    limits: dict[str, Limits] = field(default_factory=dict)
    goals: dict[str, float] = field(default_factory=dict)
    in_quick: bool = True
    is_sound: bool = True

    @property
    def reason(self) -> str:
        """What must come out and why, in a sentence."""
        return f"{self.expected}: {self.why}"


def refusal(
    name: str, why: str, attempt: Callable[[], object], words: str = "", *, in_quick: bool = True
) -> StabilityCase:
    """Return a case that must end in a clear error.

    Parameters
    ----------
    name, why
        Of the case.
    attempt
        What must raise.
    words
        What the message must hold.
    in_quick
        Whether the quick version of the study runs it.
    """

    def run(_context: StudyContext) -> Outcome:
        try:
            attempt()
        except ValueError as error:
            message = str(error)
            is_clear = bool(message) and "\n" not in message and words in message
            return Outcome(numbers={REFUSED: float(is_clear)})
        return Outcome(numbers={REFUSED: 0.0})

    return StabilityCase(
        name=name,
        expected=f"an error in one line{f' that names {words!r}' if words else ''}",
        why=why,
        run=run,
        limits={REFUSED: (1.0, 1.0)},
        in_quick=in_quick,
        is_sound=False,
    )


def checks_of_case(case: StabilityCase, family: str) -> list[Check]:
    """Return a check for each number of a case; the case runs once for all of them."""
    limits = {UNSOUND: EXACT} if case.is_sound else {}
    return [
        Check(
            name=f"{case.name}, {number}",
            configuration=family,
            scene=case.reason,
            measure=partial(_measure, case=case, number=number),
            limit_low=low,
            limit_high=high,
            goal=case.goals.get(number),
            in_quick=case.in_quick,
        )
        for number, (low, high) in (limits | case.limits).items()
    ]


def outcome_of(context: StudyContext, case: StabilityCase) -> Outcome | None:
    """Return what a case gave, or None where it broke: then it says on standard error what did."""

    def run() -> Outcome | None:
        context.progress(case.name, 0.0)
        try:
            return case.run(context)
        except Exception as error:  # noqa: BLE001, RUF100  # the other cases still have to run
            line = f"{case.name}: {type(error).__name__}: {error}"
            sys.stderr.write(" ".join(line.split()) + "\n")
            return None

    return context.once(f"stability, {case.name}", run)


def _measure(context: StudyContext, case: StabilityCase, number: str) -> Measured:
    outcome = outcome_of(context, case)
    if outcome is None:
        return Measured(value=math.nan)
    if number == UNSOUND:
        return Measured(value=float(sum(unsound(each) for each in outcome.pictures)))
    return Measured(value=outcome.numbers[number])


def unsound(picture: np.ndarray) -> int:
    """Count the values of a picture that are no light."""
    return int(np.count_nonzero(~(np.isfinite(picture) & (picture >= 0.0))))


def largest_difference(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the largest difference of any value, over the largest value of the truth."""
    return float(np.abs(found.astype(np.float64) - truth).max() / truth.max())


def mean_difference(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean difference over the mean of the truth."""
    return float(np.abs(found.astype(np.float64) - truth).mean() / truth.mean())


def energy(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the ratio of the means."""
    return float(found.mean(dtype=np.float64) / truth.mean(dtype=np.float64))
