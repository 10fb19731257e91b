"""The record that every metric returns."""

from __future__ import annotations

from dataclasses import dataclass

from metrics.confidence import Estimate


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One number about one component, with everything needed to read it."""

    name: str
    """Metric, with what tells it from its relatives (``relmse_e2``)."""
    component: str
    """Part of the light that was compared: ``image``, ``indirect``, ..."""
    value: float
    """Best estimate."""
    low: float | None
    """Lower end of the confidence interval; None where the metric has none."""
    high: float | None
    """Upper end of the confidence interval; None where the metric has none."""
    formula: str
    """What was computed, in words and symbols: V test, R reference, M batches."""
    unit: str
    """Unit of the value; empty for a pure number."""
    ideal: float
    """Value of a test that equals its reference."""
    note: str = ""
    """What a reader must know about this value, if anything."""

    @classmethod
    def from_estimate(
        cls,
        estimate: Estimate,
        *,
        name: str,
        component: str,
        formula: str,
        ideal: float,
        unit: str = "",
        note: str = "",
    ) -> Measurement:
        """Measurement that takes its value and interval from an estimate."""
        return cls(
            name=name,
            component=component,
            value=estimate.value,
            low=estimate.low,
            high=estimate.high,
            formula=formula,
            unit=unit,
            ideal=ideal,
            note=note,
        )
