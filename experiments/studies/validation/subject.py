"""What the table of validations asks of every artefact metric.

A subject measures input whose artefact has a known size, its cause. From that follow the same rows
for every metric: closed form, monotony, zero, noise, coverage, planted faults, and one NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from metrics.confidence import Estimate
from metrics.measurement import Measurement
from metrics.synthetic import Noise, gamma_noise, gaussian_noise, no_noise

DRAWS = (200, 80)
"""References drawn for a coverage, in the whole study and in the quick one."""

LEAST_COVERAGE = 0.9
"""An exact 95 % interval holds the truth in fewer than 180 of 200 draws twice in 1000 times."""

ROUNDING = 1e-9
"""Of sums of a few thousand float64 values near 1."""

MOST_SHIFT = 1.0
"""Half widths by which noise may move the mean of all draws."""

LEAST_SEPARATION = 2.0
"""Half widths of both intervals together; about four standard errors."""

LEAST_FACTOR = 1.5
"""By how much a planted fault must raise a number that has no interval."""

NEAR_ZERO = 0.05
"""Share of the known artefact that the reference itself may seem to have."""

NOISES: dict[str, Noise] = {
    "Gaussian noise of 10 %": gaussian_noise(0.1),
    "gamma noise of 50 %": gamma_noise(0.5),
}
"""Noise of one batch of a reference."""

Interval = Estimate | Measurement | Measured


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A metric, and input on which its answer is known.

    Attributes
    ----------
    name
        The metric.
    case
        The input, in words.
    cause
        What sets the size of the artefact, in words.
    measure
        Value of input with this cause, noise and seed.
    causes
        Causes in the order in which the value must rise, the first free of it.
    known, answer
        A cause, and the value that it must give.
    tolerance
        Relative, of that value.
    broken
        Measures input with one NaN.
    faults
        Planted faults by name: the cause without the fault and with it.
    zero
        Cause of the reference itself; None where it has none.
    noises
        What the reference's noise may be; nothing without randomness.
    has_interval
        Whether the metric states one.
    is_bound
        Whether the value is a bound from below, which noise lowers as it should.
    """

    name: str
    case: str
    cause: str
    measure: Callable[[float, Noise, int], Interval]
    causes: tuple[float, ...]
    known: float
    answer: float
    tolerance: float
    broken: Callable[[], object]
    faults: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    zero: float | None = 0.0
    noises: Mapping[str, Noise] = field(default_factory=lambda: NOISES)
    has_interval: bool = True
    is_bound: bool = False

    def checks(self) -> list[Check]:
        """Return the rows of this metric."""
        found = [
            self._check(
                "closed form, value over truth", self._closed, *_around(1.0, self.tolerance)
            ),
            self._check(f"monotone, violations as {self.cause} rises", self._violations, 0.0, 0.0),
        ]
        if self.zero is not None:
            found.append(
                self._check(
                    "reference itself, over the known artefact", self._zero, None, NEAR_ZERO
                )
            )
        for words, noise in self.noises.items() if self.has_interval else ():
            shift = partial(self._shift, words=words, noise=noise)
            least = None if self.is_bound else -MOST_SHIFT
            found.append(
                self._check(f"{words}, mean shift in half widths", shift, least, MOST_SHIFT)
            )
            covered = {"coverage of intervals": self.known}
            if self.zero is not None:
                covered["coverage of 0 by the reference itself"] = self.zero
            for what, cause in covered.items():
                cover = partial(self._coverage, cause=cause, words=words, noise=noise)
                found.append(self._check(f"{words}, {what}", cover, LEAST_COVERAGE, 1.0))
        for words, (without, with_fault) in self.faults.items():
            least = LEAST_SEPARATION if self.has_interval else LEAST_FACTOR
            unit = "half widths" if self.has_interval else "a factor"
            apart = partial(self._separation, without=without, with_fault=with_fault)
            found.append(
                self._check(f"planted fault, {words}, separation as {unit}", apart, least, None)
            )
        return [*found, self._check("planted fault, one NaN, 1 if refused", self._nan, 1.0, 1.0)]

    def _check(
        self,
        question: str,
        measure: Callable[[StudyContext], Measured],
        low: float | None,
        high: float | None,
    ) -> Check:
        return Check(
            name=f"{self.name}: {question}",
            configuration=f"the metric alone; {DRAWS[0]} draws where drawn",
            scene=self.case,
            measure=measure,
            limit_low=low,
            limit_high=high,
        )

    def _closed(self, context: StudyContext) -> Measured:
        del context
        return Measured(value=self.measure(self.known, no_noise, 0).value / self.answer)

    def _violations(self, context: StudyContext) -> Measured:
        del context
        values = [self.measure(cause, no_noise, 0).value for cause in self.causes]
        return Measured(value=float(sum(not low < high for low, high in pairwise(values))))

    def _zero(self, context: StudyContext) -> Measured:
        del context
        assert self.zero is not None
        known = self.measure(self.known, no_noise, 0).value
        return Measured(value=abs(self.measure(self.zero, no_noise, 0).value) / known)

    def _drawn(self, context: StudyContext, cause: float, words: str, noise: Noise) -> np.ndarray:
        """Value, low and high [draw, 3] in noise, measured once."""

        def draw() -> np.ndarray:
            found = []
            for seed in range(DRAWS[context.quick]):
                context.progress(words, seed / DRAWS[context.quick])
                each = self.measure(cause, noise, seed + 1)
                assert each.low is not None
                assert each.high is not None
                found.append((each.value, each.low, each.high))
            return np.array(found)

        return context.once(f"{self.name}, {cause:g}, {words}", draw)

    def _shift(self, context: StudyContext, words: str, noise: Noise) -> Measured:
        value, low, high = self._drawn(context, self.known, words, noise).T
        half = 0.5 * float(np.mean(high - low))
        error = float(value.std(ddof=1)) / math.sqrt(len(value))
        shift = float(value.mean()) - self.measure(self.known, no_noise, 0).value
        ends = [(shift + side * 2.0 * error) / half for side in (-1.0, 1.0)]
        return Measured(value=shift / half, low=ends[0], high=ends[1])

    def _coverage(self, context: StudyContext, cause: float, words: str, noise: Noise) -> Measured:
        """Share of intervals that hold what is found without noise, with that of a binomial."""
        _, low, high = self._drawn(context, cause, words, noise).T
        truth = self.measure(cause, no_noise, 0).value
        is_inside = (low - ROUNDING <= truth) & (truth <= high + ROUNDING)
        share = float(np.mean(is_inside))
        error = math.sqrt(max(share * (1.0 - share), 1.0 / len(low)) / len(low))
        return Measured(
            value=share, low=max(share - 2.0 * error, 0.0), high=min(share + 2.0 * error, 1.0)
        )

    def _separation(self, context: StudyContext, without: float, with_fault: float) -> Measured:
        del context
        noise = next(iter(self.noises.values()), no_noise)
        plain, wrong = (self.measure(cause, noise, 1) for cause in (without, with_fault))
        if not self.has_interval:
            return Measured(value=wrong.value / max(plain.value, np.finfo(np.float64).tiny))
        widths = []
        for each in (plain, wrong):
            assert each.low is not None
            assert each.high is not None
            widths.append(0.5 * (each.high - each.low))
        return Measured(value=(wrong.value - plain.value) / math.hypot(*widths))

    def _nan(self, context: StudyContext) -> Measured:
        del context
        try:
            self.broken()
        except ValueError:
            return Measured(value=1.0)
        return Measured(value=0.0)


def _around(middle: float, tolerance: float) -> tuple[float, float]:
    return middle - tolerance, middle + tolerance
