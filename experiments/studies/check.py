"""What a study is made of: checks, each of which measures one number.

A study is a module with a function ``checks() -> list[Check]``, which says what would be measured
without measuring it. So a single number can be asked for, and what it does not need is not done.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar, cast

import numpy as np
from scipy.special import stdtrit

from experiments.studies.figures import FigureShelf, Point
from reference import NoisyReferenceError

Shared = TypeVar("Shared")

INTERVAL_LEVEL = 0.95
"""Probability that an interval holds the true value."""


class RefusedError(Exception):
    """Nothing can be measured, for the reason that the message gives; the row says so."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A number and its interval, of which both ends are None where it has none."""

    value: float
    low: float | None = None
    high: float | None = None
    note: str = ""
    """What a reader must know about this value, such as that it is a bound."""


@dataclass(kw_only=True)
class StudyContext:
    """What a measurement may ask of its surroundings.

    Attributes
    ----------
    quick
        Whether the smaller version of the study runs, at most a minute in all on two cores.
    progress
        Takes a step and the share of it that is done, in [0, 1].
    shelf
        Takes figures for the record and the page of the study.
    scene
        The scene that the user asked for, or None: then each study has its own.
    """

    quick: bool
    progress: Callable[[str, float], None]
    shelf: FigureShelf = field(default_factory=FigureShelf)
    scene: str | None = None
    _found: dict[str, object] = field(default_factory=dict)

    def once(self, key: str, measure: Callable[[], Shared]) -> Shared:
        """Return what `measure` gives, measured once for all checks that ask by the same key.

        Raises
        ------
        RefusedError, NoisyReferenceError
            `measure` raised it, at this call or an earlier one: refusals are kept, too.
        """
        if key not in self._found:
            try:
                self._found[key] = measure()
            except (RefusedError, NoisyReferenceError) as refusal:
                self._found[key] = refusal
        found = self._found[key]
        if isinstance(found, RefusedError | NoisyReferenceError):
            raise found
        return cast("Shared", found)


@dataclass(frozen=True, kw_only=True)
class Check:
    """One number that a study measures.

    Attributes
    ----------
    name
        What is measured, unique within the study; ``--only`` selects by it.
    configuration, scene
        With what settings, and of what.
    measure
        Measures it.
    limit_low, limit_high
        What the value must keep to; without either it only has to be finite.
    goal
        What one would like to see; it decides nothing.
    in_quick
        Whether the quick version of the study measures it, too.
    is_headline
        Whether it is read first.
    points
        Where it stands on curves of the study's page.
    """

    name: str
    configuration: str
    scene: str
    measure: Callable[[StudyContext], Measured]
    limit_low: float | None = None
    limit_high: float | None = None
    goal: float | None = None
    in_quick: bool = True
    is_headline: bool = False
    points: tuple[Point, ...] = ()


def mean_of(values: Sequence[float]) -> Measured:
    """Return the mean of independent repetitions, with Student's t interval for it.

    A single repetition has no interval.

    Raises
    ------
    ValueError
        There are no values.
    """
    count = len(values)
    if count == 0:
        raise ValueError("mean_of: there is nothing to take the mean of.")
    mean = math.fsum(values) / count
    if count == 1:
        return Measured(value=mean)
    error = float(np.std(values, ddof=1)) / math.sqrt(count)
    half = float(stdtrit(count - 1, 0.5 * (1.0 + INTERVAL_LEVEL))) * error
    return Measured(value=mean, low=mean - half, high=mean + half)
