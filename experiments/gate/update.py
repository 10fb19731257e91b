"""Writing baselines: only when asked, only with a reason, only from records that hold."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from pathlib import Path

from experiments.errors import InputError, MachineryError
from experiments.gate.baseline import (
    Baseline,
    BaselineMetric,
    BaselineTime,
    baseline_path,
    config_hash,
    environment_of,
    reference_of,
)
from experiments.gate.budget import find_time, find_voxel_bytes
from experiments.gate.evaluation import ERROR, evaluate
from experiments.gate.finding import find_metric
from experiments.gate.scales import metric_from_axis
from experiments.gate.specification import (
    Absolute,
    AnyMetricGate,
    GateSpec,
    NonInferior,
    Settings,
)
from experiments.gate.tolerance import estimate_of
from reports.junit import Verdict
from reports.record import Record

DEFAULT_LEVEL = 0.95
"""Confidence level that a declared noise stands for."""


def update_baselines(
    records: Iterable[tuple[GateSpec, Record, Path]], folder: Path, reason: str
) -> list[Path]:
    """Write a baseline from each record.

    Parameters
    ----------
    records
        Each gate with its record and the record's file.
    folder
        Where baselines live; made when missing.
    reason
        Why the numbers are right; kept in the file.

    Returns
    -------
    list of Path
        The files written. Nothing is written when any record is refused.

    Raises
    ------
    InputError
        When the reason is empty, or a record fails a check that needs no history (finite,
        absolute), or a tolerance would let the weakest mutant through.
    MachineryError
        When the reference is too noisy for a tolerance, a picture is missing, or a file cannot
        be written.
    """
    if not reason.strip():
        raise InputError("no reason", "--reason", "say why the new numbers are right")
    written: list[tuple[Path, Baseline]] = []
    for gate, record, record_path in records:
        baseline = baseline_from_record(gate, record, reason.strip())
        _require_own_record_passes(gate, record, record_path, baseline)
        written.append((baseline_path(folder, gate, record.machine.backend), baseline))
    for path, baseline in written:
        write_model(path, baseline)
    return [path for path, _ in written]


def baseline_from_record(gate: GateSpec, record: Record, reason: str) -> Baseline:
    """Take from a record what its gate compares.

    Raises
    ------
    InputError
        When the record lacks a metric or stage of the gate.
    """
    times = [find_time(record, budget.stage) for budget in gate.budgets]
    return Baseline(
        gate=gate.name,
        scene=gate.scene,
        preset=gate.preset,
        backend=record.machine.backend,
        method=record.method,
        reason=reason,
        created=record.created,
        commit=record.machine.commit,
        is_dirty=record.machine.is_dirty,
        scene_digest=record.scene.digest,
        config_hash=config_hash(record.config),
        width=record.width,
        height=record.height,
        metrics=[_baseline_metric(metric_gate, record) for metric_gate in gate.metrics],
        times=[
            BaselineTime(
                stage=time.stage,
                median_ms=time.median_ms,
                low_ms=time.low_ms,
                high_ms=time.high_ms,
            )
            for time in times
        ],
        voxel_bytes=None if gate.memory is None else find_voxel_bytes(record),
        display=record.display,
        environment=environment_of(record.machine),
        reference=reference_of(record),
    )


def _baseline_metric(gate: AnyMetricGate, record: Record) -> BaselineMetric:
    metric = find_metric(record, gate.metric, gate.component)
    low = high = metric.value
    level = DEFAULT_LEVEL
    if metric.interval is not None:
        low, high, level = metric.interval.low, metric.interval.high, metric.interval.level
    elif isinstance(gate, Absolute | NonInferior):
        estimate = estimate_of(gate, metric)
        ends = (
            metric_from_axis(gate.scale, estimate.low),
            metric_from_axis(gate.scale, estimate.high),
        )
        low, high = min(*ends, metric.value), max(*ends, metric.value)
    return BaselineMetric(
        value=metric.value,
        low=low,
        high=high,
        level=level,
        formula=metric.formula,
        tolerance=gate,
    )


def _require_own_record_passes(
    gate: GateSpec, record: Record, record_path: Path, baseline: Baseline
) -> None:
    """Refuse what would fail at once, or what fails to gate: the checks are those of the gate."""
    refuse_failing(evaluate(record, record_path, gate, baseline))


def refuse_failing(verdicts: Iterable[Verdict]) -> None:
    """Refuse to make a baseline from what fails a verdict.

    Raises
    ------
    InputError, MachineryError
        A verdict has failed, or could not be reached.
    """
    for verdict in verdicts:
        if verdict.passed:
            continue
        error_class = MachineryError if verdict.kind == ERROR else InputError
        raise error_class(
            f"no baseline from a record that fails its own gate [{verdict.kind}]",
            verdict.gate,
            verdict.message,
        )


def write_model(path: Path, baseline: Settings) -> None:
    """Replace the file in one step, so that no reader meets half a baseline.

    Raises
    ------
    MachineryError
        It cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            temporary.write_text(baseline.model_dump_json(indent=2) + "\n", encoding="utf-8")
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise MachineryError(
            f"cannot write the baseline ({error.strerror})", str(path), "make its folder writable"
        ) from error
