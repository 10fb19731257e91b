"""The kind `order`: of two records, the one that should be better must not be worse."""

from __future__ import annotations

from experiments.errors import InputError, MachineryError
from experiments.gate.finding import Finding, find_metric
from experiments.gate.scales import Estimate, Scale, estimate_from_bounds
from experiments.gate.specification import Order
from reports.record import Record


def check_order(order: Order, better: Record, worse: Record) -> Finding:
    """Compare the intervals of one metric in two records.

    Parameters
    ----------
    order
        The metric, its scale, and the names of both gates.
    better, worse
        Their records: `better` should have the smaller error (the ratio nearer to 1).

    Returns
    -------
    Finding
        Passed when the better interval lies below, failed when it lies above.

    Raises
    ------
    MachineryError
        When the intervals overlap, so that noise decides.
    InputError
        When a record lacks the metric or its interval.
    """
    near, far = _badness(order, better), _badness(order, worse)
    value = find_metric(better, order.metric, order.component).value
    return compare_order(order.name, (order.better, near), (order.worse, far), value)


def compare_order(
    name: str, better: tuple[str, Estimate], worse: tuple[str, Estimate], value: float
) -> Finding:
    """Compare two intervals, each with what it is of; see `check_order`.

    Raises
    ------
    MachineryError
        When the intervals overlap.
    """
    near, far = better[1], worse[1]
    text = f"{better[0]} {_text(near)}, {worse[0]} {_text(far)} (distance from ideal)"
    if near.low <= far.high and far.low <= near.high:
        raise MachineryError(
            f"the intervals overlap: {text}",
            f"order {name}",
            "raise the samples, or compare two that lie further apart",
        )
    return Finding(
        kind="order",
        passed=near.high < far.low,
        value=value,
        limit=f"{better[0]} below {worse[0]}",
        message=text,
    )


def _badness(order: Order, record: Record) -> Estimate:
    """Distance from ideal: a ratio's |logarithm|, others as they stand on their axis."""
    metric = find_metric(record, order.metric, order.component)
    where = f"{order.metric} of {order.component} in record {record.record_id}"
    if metric.interval is None:
        raise InputError("the metric has no interval", where, "order one that has")
    low, high = metric.interval.low, metric.interval.high
    estimate = estimate_from_bounds(order.scale, metric.value, low, high, where)
    return distance_from_ideal(order.scale, estimate)


def distance_from_ideal(scale: Scale, estimate: Estimate) -> Estimate:
    """Return how bad an estimate on an axis is: the size of a ratio's logarithm, others as is."""
    if scale != "ratio":
        return estimate
    ends = sorted((abs(estimate.low), abs(estimate.high)))
    nearest = 0.0 if estimate.low <= 0.0 <= estimate.high else ends[0]
    return Estimate(abs(estimate.value), nearest, ends[1])


def _text(estimate: Estimate) -> str:
    return f"{estimate.value:.5g} [{estimate.low:.5g}, {estimate.high:.5g}]"
