"""The test behind the kind `equal`: whether two intervals belong to the same number."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from scipy import special

from experiments.errors import InputError, MachineryError
from experiments.gate.scales import Estimate
from experiments.gate.specification import Equal
from experiments.gate.tolerance import effect_on_axis

DETECTION_SIGMAS: Final = 3.0
"""The weakest mutant must lie this many standard errors of the difference beyond the critical
value; it is then missed about once in a thousand."""


@dataclass(frozen=True)
class Measured:
    """A number with the standard error behind its interval."""

    value: float
    standard_error: float
    degrees_of_freedom: int


def measured_from(estimate: Estimate, *, level: float, batch_count: int, where: str) -> Measured:
    """Undo a t-interval over batches: half-width / t((1 + level) / 2, batches - 1).

    Raises
    ------
    MachineryError
        When there are fewer than two batches, which show no spread.
    """
    if batch_count < 2:
        raise MachineryError(
            "one batch has no spread to test with", where, "render the reference in 2 or more"
        )
    freedom = batch_count - 1
    quantile = float(special.stdtrit(freedom, 0.5 * (1.0 + level)))
    return Measured(estimate.value, estimate.half_width / quantile, freedom)


def difference_in_errors(record: Measured, baseline: Measured) -> tuple[float, int]:
    """Return |difference| in standard errors of the difference, and its degrees of freedom.

    The freedom is the smaller of the two, which never promises too few false alarms. Welch's
    estimate of it does, far out in the tail where a gate works: 0.5 % instead of 0.1 % for 4
    against 16 batches. Numbers without spread are 0 apart when equal, infinitely far otherwise.
    """
    total = record.standard_error**2 + baseline.standard_error**2
    difference = abs(record.value - baseline.value)
    freedom = min(record.degrees_of_freedom, baseline.degrees_of_freedom)
    if total == 0.0:
        return (0.0 if difference == 0.0 else math.inf), freedom
    return difference / math.sqrt(total), freedom


def critical_value(significance: float, freedom: int) -> float:
    """How many standard errors a difference may reach by noise, two-sided."""
    return float(special.stdtrit(freedom, 1.0 - 0.5 * significance))


def require_power(gate: Equal, estimate: Estimate, baseline: Measured) -> None:
    """Refuse a test that the weakest mutant would pass because the intervals are wide.

    Raises
    ------
    MachineryError
        When the reference is too noisy for the effect.
    """
    effect = effect_on_axis(gate, estimate)
    _, freedom = difference_in_errors(baseline, baseline)
    needed = critical_value(gate.significance, freedom) + DETECTION_SIGMAS
    reach = needed * math.sqrt(2.0) * baseline.standard_error
    if effect <= reach:
        raise MachineryError(
            f"the weakest mutant moves the value by {effect:.4g}, the test sees {reach:.4g}",
            f"equal gate on {gate.metric} of {gate.component}",
            "raise the reference samples, or name a larger effect with effect_from",
        )


def require_path_traced(gate: Equal, method: str) -> None:
    """Refuse equality for a biased method, which could never pass it.

    Raises
    ------
    InputError
        When neither the component nor the method is path-traced.
    """
    if gate.component in PATH_TRACED_COMPONENTS or method in PATH_TRACED_METHODS:
        return
    raise InputError(
        f"{gate.component} of {method!r} is not path-traced; equality is for unbiased parts",
        f"equal gate on {gate.metric}",
        "use the kind 'noninferior'",
    )


PATH_TRACED_COMPONENTS: Final = frozenset({"emission", "direct"})
"""Components that Mitsuba renders for every method."""
PATH_TRACED_METHODS: Final = frozenset({"path", "path_tracing"})
"""Names of methods whose every component is path-traced."""
