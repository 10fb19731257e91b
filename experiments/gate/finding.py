"""What one check found, before it is tied to a gate and a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from experiments.errors import InputError
from reports.record import MetricValue, Record

UPDATE_REMEDY: Final = (
    "if the change is meant, review a new baseline made by --update --reason TEXT"
)


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Outcome of one check, with what was measured and what was allowed."""

    kind: str
    passed: bool
    value: float | None
    limit: str
    message: str


def find_metric(record: Record, metric: str, component: str) -> MetricValue:
    """Find a record's value of a metric.

    Raises
    ------
    InputError
        When the record has none, or more than one.
    """
    found = [m for m in record.metrics if (m.name, m.component) == (metric, component)]
    if len(found) == 1:
        return found[0]
    available = ", ".join(sorted({f"{m.name} of {m.component}" for m in record.metrics})) or "none"
    raise InputError(
        f"the record has {len(found)} values of {metric} of {component}",
        f"record {record.record_id}",
        f"gate one of: {available}",
    )
