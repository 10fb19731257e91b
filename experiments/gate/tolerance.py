"""Whether noise can cross a tolerance, and whether a fault can hide in it."""

from __future__ import annotations

import math
from typing import Final, Literal

from experiments.errors import InputError, MachineryError
from experiments.gate.scales import (
    Band,
    Estimate,
    axis_from_metric,
    estimate_from_bounds,
    estimate_from_noise,
)
from experiments.gate.specification import (
    Absolute,
    EffectGate,
    Equal,
    NonInferior,
    weakest_effect,
)
from reports.record import MetricValue

NOISE_FACTOR: Final = 4.0
"""A limit lies at least this many half-widths from the baseline. With 95 % t-intervals of 4 to 16
batches, a re-drawn reference on both sides then crosses it about 3 times in a million (test)."""
DETECTION_FACTOR: Final = 2.0
"""The weakest mutant must land at least this many half-widths beyond the limit; at the noisiest
baseline allowed it is then missed 7, 2.5 and 1 times in 10 000 for 4, 8 and 16 batches (test)."""
DECIDABLE_FACTOR: Final = 2.0
"""An interval across the limit is a regression only if its half-width is at most the tolerance
over this factor: its value has then moved by more than half of the tolerance. A wider one decides
nothing, whatever the truth."""

Outcome = Literal["passed", "failed", "undecided"]


def estimate_of(gate: Absolute | NonInferior, metric: MetricValue) -> Estimate:
    """Put a record's metric on the axis of its gate's scale.

    Raises
    ------
    InputError
        When the scale does not fit the metric's ideal, the metric has neither interval nor
        declared noise or has both, or a ratio is not above zero.
    """
    where = f"{gate.metric} of {gate.component}"
    require_scale(gate, metric)
    if metric.interval is None:
        if gate.noise is None:
            raise InputError(
                "the metric has no interval, and a gate compares intervals",
                where,
                "measure its spread over reference seeds and set 'noise' to that relative "
                "half-width (0 if it is deterministic)",
            )
        return estimate_from_noise(gate.scale, metric.value, gate.noise, where)
    if gate.noise is not None:
        raise InputError("the metric has an interval of its own", where, "remove 'noise'")
    low, high = metric.interval.low, metric.interval.high
    return estimate_from_bounds(gate.scale, metric.value, low, high, where)


def equal_estimate_of(gate: Equal, metric: MetricValue) -> tuple[Estimate, float]:
    """Put a record's metric on the axis of an equality gate; also its confidence level.

    Raises
    ------
    InputError
        When the scale does not fit, or the metric has no interval.
    """
    where = f"{gate.metric} of {gate.component}"
    require_scale(gate, metric)
    if metric.interval is None:
        raise InputError("the metric has no interval", where, "use another kind of gate")
    low, high = metric.interval.low, metric.interval.high
    return estimate_from_bounds(gate.scale, metric.value, low, high, where), metric.interval.level


def require_scale(gate: EffectGate, metric: MetricValue) -> None:
    """Refuse a scale that does not fit the metric.

    Raises
    ------
    InputError
        When an error's ideal is not 0, or that of a ratio or similarity not 1.
    """
    ideal = 0.0 if gate.scale == "error" else 1.0
    if metric.ideal != ideal:
        raise InputError(
            f"the scale {gate.scale!r} is for an ideal of {ideal:g}, the metric's is "
            f"{metric.ideal:g}",
            f"{gate.metric} of {gate.component}",
            "set scale to 'error' for an ideal of 0, to 'ratio' or 'similarity' for 1",
        )


def absolute_band(gate: Absolute) -> Band:
    """Return what an absolute gate accepts, on the axis of its scale."""
    where = f"{gate.metric} of {gate.component}"
    if gate.cap is not None:
        return Band(-math.inf, gate.cap)
    assert gate.low is not None, "the specification gives every absolute gate a limit"
    lower = axis_from_metric(gate.scale, gate.low, where)
    if gate.high is None:
        return Band(-math.inf, lower)
    return Band(lower, axis_from_metric(gate.scale, gate.high, where))


def noninferior_band(gate: NonInferior, baseline: Estimate) -> Band:
    """Return what a non-inferiority gate accepts around its baseline.

    An error's limit is value + rel |value| + abs: the same as value (1 + rel) + abs, also for
    the negative estimates that a noise-corrected error below the noise floor may have. A
    ratio may move by the factor (1 + rel) exp(abs) up and down, also towards 1: energy x 1.05
    on a picture that was too dark is a fault, although the ratio looks better for it.
    """
    if gate.scale == "ratio":
        margin = math.log1p(gate.rel) + gate.abs
        return Band(baseline.value - margin, baseline.value + margin)
    return Band(-math.inf, baseline.value + gate.rel * abs(baseline.value) + gate.abs)


def band_of(gate: Absolute | NonInferior, baseline: Estimate) -> Band:
    """Return what a gate accepts, given its baseline."""
    return absolute_band(gate) if isinstance(gate, Absolute) else noninferior_band(gate, baseline)


def effect_on_axis(gate: EffectGate, baseline: Estimate) -> float:
    """How far the weakest mutant moves the baseline along the axis, > 0 unless it is zero."""
    if gate.effect_abs is not None:
        return gate.effect_abs
    effect = weakest_effect(gate)
    return math.log1p(effect) if gate.scale == "ratio" else effect * abs(baseline.value)


def decide(estimate: Estimate, band: Band, margin: float) -> Outcome:
    """Compare an interval with a band.

    Parameters
    ----------
    estimate
        The record's number, on the axis of the band.
    band
        What is accepted.
    margin
        Distance from the baseline to the nearest limit; infinite without a baseline.

    Returns
    -------
    Outcome
        `passed` when the interval lies inside; `failed` when it lies outside, or lies across a
        limit and is narrow enough that noise alone would not have brought it there;
        `undecided` when it lies across and is wider than that.
    """
    if band.low <= estimate.low and estimate.high <= band.high:
        return "passed"
    is_outside = estimate.low > band.high or estimate.high < band.low
    if is_outside or estimate.half_width * DECIDABLE_FACTOR <= margin:
        return "failed"
    return "undecided"


def margin_of(band: Band, baseline: Estimate) -> float:
    """Distance from the baseline's value to the nearest limit; negative when it lies outside."""
    return min(sign * (limit - baseline.value) for sign, limit in band.sides())


def require_sane(gate: Absolute | NonInferior, band: Band, baseline: Estimate) -> None:
    """Refuse a tolerance that noise crosses or that the weakest mutant does not cross.

    Raises
    ------
    MachineryError
        When the baseline's interval is too wide for the tolerance: the reference is too noisy.
    InputError
        When the tolerance is too wide for the weakest mutant to be caught, or the baseline lies
        beyond its limit.
    """
    where = f"{gate.kind} gate on {gate.metric} of {gate.component}"
    margin = margin_of(band, baseline)
    if margin < 0.0:
        raise InputError(
            f"the baseline itself lies {-margin:.4g} beyond the limit",
            where,
            "move the limit, or mend what the record shows",
        )
    if margin < NOISE_FACTOR * baseline.half_width:
        shortfall = NOISE_FACTOR * baseline.half_width / margin if margin > 0.0 else math.inf
        raise MachineryError(
            f"the tolerance is {margin:.4g} and the interval's half-width {baseline.half_width:.4g}"
            f": under {NOISE_FACTOR:g} half-widths, noise fails the gate",
            where,
            f"raise the reference samples (about {shortfall**2:.1f} times as many), or widen the "
            "tolerance",
        )
    effect = effect_on_axis(gate, baseline)
    reach = DETECTION_FACTOR * baseline.half_width
    for sign, limit in band.sides():
        distance = sign * (limit - baseline.value)
        if distance + reach >= effect:
            raise InputError(
                f"the limit is {distance:.4g} (+ {reach:.4g} for noise) from the baseline, the "
                f"weakest mutant only {effect:.4g}: it would pass",
                where,
                "narrow the tolerance, raise the reference samples, or name a larger effect with "
                "effect_from",
            )
