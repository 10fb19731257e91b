"""The kinds of gate on one metric: `absolute`, `noninferior`, `equal` and `exact`."""

from __future__ import annotations

from experiments.errors import MachineryError
from experiments.gate.baseline import Baseline, BaselineMetric
from experiments.gate.display import same_formula
from experiments.gate.equality import (
    critical_value,
    difference_in_errors,
    measured_from,
    require_path_traced,
    require_power,
)
from experiments.gate.finding import UPDATE_REMEDY, Finding, find_metric
from experiments.gate.scales import Scale, band_text, metric_from_axis
from experiments.gate.specification import (
    Absolute,
    AnyMetricGate,
    Equal,
    Exact,
    NonInferior,
)
from experiments.gate.tolerance import (
    absolute_band,
    band_of,
    decide,
    equal_estimate_of,
    estimate_of,
    margin_of,
    require_sane,
)
from reports.record import MetricValue, Record


def check_metric(gate: AnyMetricGate, record: Record, baseline: Baseline | None) -> Finding | None:
    """Hold one metric to its gate.

    Parameters
    ----------
    gate
        Kind and tolerance as they stand in `gates.toml`.
    record
        What was measured.
    baseline
        What it is compared with.

    Returns
    -------
    Finding or None
        None when there is no baseline and this kind says nothing without one.

    Raises
    ------
    InputError
        When the metric or its scale does not exist, or the weakest mutant would pass.
    MachineryError
        When the reference is too noisy to decide.
    """
    metric = find_metric(record, gate.metric, gate.component)
    if baseline is None:
        return check_band(gate, metric, None) if isinstance(gate, Absolute) else None
    entry = baseline.metric_for(gate)
    stale = _stale(gate, record, metric, baseline, entry)
    if stale is not None or entry is None:
        return stale
    if isinstance(gate, Exact):
        return check_same_number(metric, entry)
    if isinstance(gate, Equal):
        return _equal(gate, record, metric, baseline, entry)
    return check_band(gate, metric, entry)


def _stale(
    gate: AnyMetricGate,
    record: Record,
    metric: MetricValue,
    baseline: Baseline,
    entry: BaselineMetric | None,
) -> Finding | None:
    """Fail when the baseline was reviewed for another gate, tolerance or formula."""
    if entry is None:
        limit, message = "a reviewed value", "the baseline has no value for this gate"
    elif entry.tolerance != gate:
        limit = "the tolerance reviewed with the baseline"
        message = "the tolerance was changed since the baseline was reviewed"
    elif not same_formula(
        metric.name, (metric.formula, record.display), (entry.formula, baseline.display)
    ):
        limit = f"formula: {entry.formula}"
        message = f"the formula is now: {metric.formula}"
    else:
        return None
    return Finding(
        kind=gate.kind,
        passed=False,
        value=metric.value,
        limit=limit,
        message=f"{message}; {UPDATE_REMEDY}",
    )


def check_same_number(metric: MetricValue, entry: BaselineMetric) -> Finding:
    """Compare a number with its baseline bit for bit."""
    passed = metric.value == entry.value
    return Finding(
        kind="exact",
        passed=passed,
        value=metric.value,
        limit=f"exactly {entry.value!r}",
        message="the same" if passed else f"was {entry.value!r}; {UPDATE_REMEDY}",
    )


def check_band(
    gate: Absolute | NonInferior, metric: MetricValue, entry: BaselineMetric | None
) -> Finding:
    """Compare an interval with the band that the gate allows; see `check_metric` for errors."""
    estimate = estimate_of(gate, metric)
    margin = float("inf")
    if entry is None:
        assert isinstance(gate, Absolute), "only a cap means something without a baseline"
        band = absolute_band(gate)
    else:
        before = entry.estimate()
        band = band_of(gate, before)
        require_sane(gate, band, before)
        margin = margin_of(band, before)
    outcome = decide(estimate, band, margin)
    measured = _interval_text(gate.scale, estimate.value, estimate.low, estimate.high)
    baseline_text = "" if entry is None else f"; baseline {_entry_text(entry)}"
    limit = band_text(gate.scale, band)
    if outcome == "undecided":
        raise MachineryError(
            f"{measured} lies across the limit ({limit}) and is too wide to decide{baseline_text}",
            f"{gate.kind} gate on {gate.metric} of {gate.component}",
            "raise the reference samples",
        )
    message = f"{measured}{baseline_text}"
    if outcome == "failed":
        message += f"; {UPDATE_REMEDY}" if isinstance(gate, NonInferior) else "; find the cause"
    return Finding(
        kind=gate.kind,
        passed=outcome == "passed",
        value=metric.value,
        limit=limit,
        message=message,
    )


def _equal(
    gate: Equal, record: Record, metric: MetricValue, baseline: Baseline, entry: BaselineMetric
) -> Finding:
    """Test two means over batches for equality, on the axis of the scale."""
    where = f"equal gate on {gate.metric} of {gate.component}"
    require_path_traced(gate, record.method)
    if record.reference is None or baseline.reference is None:
        raise MachineryError("no reference", where, "render it and record it")
    estimate, level = equal_estimate_of(gate, metric)
    batch_counts = (record.reference.batch_count, baseline.reference.batch_count)
    now = measured_from(estimate, level=level, batch_count=batch_counts[0], where=where)
    before = entry.estimate()
    then = measured_from(before, level=entry.level, batch_count=batch_counts[1], where=where)
    require_power(gate, before, then)
    distance, freedom = difference_in_errors(now, then)
    critical = critical_value(gate.significance, freedom)
    passed = distance <= critical
    return Finding(
        kind="equal",
        passed=passed,
        value=metric.value,
        limit=f"<= {critical:.2f} standard errors from {_entry_text(entry)}",
        message=f"{distance:.2f} standard errors" + ("" if passed else f"; {UPDATE_REMEDY}"),
    )


def _interval_text(scale: Scale, value: float, low: float, high: float) -> str:
    bounds = sorted((metric_from_axis(scale, low), metric_from_axis(scale, high)))
    return f"{metric_from_axis(scale, value):.5g} [{bounds[0]:.5g}, {bounds[1]:.5g}]"


def _entry_text(entry: BaselineMetric) -> str:
    return f"{entry.value:.5g} [{entry.low:.5g}, {entry.high:.5g}]"
