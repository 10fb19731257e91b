"""The kind `budget`: a stage's time, on the machine that the baseline was measured on."""

from __future__ import annotations

from experiments.errors import InputError
from experiments.gate.baseline import Baseline, BaselineTime, environment_of
from experiments.gate.finding import UPDATE_REMEDY, Finding
from experiments.gate.specification import SLOWDOWN, Budget, Memory
from reports.record import Record, StageTime


def find_time(record: Record, stage: str) -> StageTime:
    """Find a record's time of a stage.

    Raises
    ------
    InputError
        When the record has none, or more than one.
    """
    found = [time for time in record.times if time.stage == stage]
    if len(found) == 1:
        return found[0]
    raise InputError(
        f"the record has {len(found)} times of {stage}",
        f"record {record.record_id}",
        f"set a budget for one of: {', '.join(time.stage for time in record.times) or 'none'}",
    )


def check_budget(budget: Budget, record: Record, baseline: Baseline) -> Finding:
    """Fail when the whole spread of a stage's time lies over its limit.

    On another machine (back end, device, processor or core count) the finding passes and says
    that it is advisory.

    Raises
    ------
    InputError
        When the stage does not exist, or one of twice its time would pass.
    """
    time = find_time(record, budget.stage)
    entry = next((stored for stored in baseline.times if stored.stage == budget.stage), None)
    if entry is None:
        return Finding(
            kind="budget",
            passed=False,
            value=time.median_ms,
            limit="a reviewed time",
            message=f"the baseline has no time for this stage; {UPDATE_REMEDY}",
        )
    require_sane_budget(budget, entry)
    limit = budget_limit_ms(budget, entry)
    is_slow = time.low_ms > limit
    differences = baseline.environment.different_machine(environment_of(record.machine))
    spread = f"{time.median_ms:.4g} ms [{time.low_ms:.4g}, {time.high_ms:.4g}]"
    message = f"{spread}; baseline {entry.median_ms:.4g} ms"
    if differences:
        message = f"advisory, another machine: {'; '.join(differences)}; {message}"
    elif is_slow:
        message = f"{message}; {UPDATE_REMEDY}"
    return Finding(
        kind="budget",
        passed=bool(differences) or not is_slow,
        value=time.median_ms,
        limit=f"low end of the spread <= {limit:.4g} ms",
        message=message,
    )


def find_voxel_bytes(record: Record) -> int:
    """Return the size of the voxels of a record.

    Raises
    ------
    InputError
        The record does not tell.
    """
    if record.cost is None:
        raise InputError(
            "the record does not say how much memory its voxels take",
            f"record {record.record_id}",
            "render it with counting",
        )
    return record.cost.voxel_bytes


def check_memory(memory: Memory, record: Record, baseline: Baseline) -> Finding:
    """Fail when the voxels have grown; their size is the same on every machine.

    Raises
    ------
    InputError
        The record does not tell.
    """
    size, before = find_voxel_bytes(record), baseline.voxel_bytes
    if before is None:
        limit, passed, message = "a reviewed size", False, "the baseline has no size of voxels"
    else:
        most = before * (1.0 + memory.rel)
        limit, passed = f"<= {most:.0f} bytes", size <= most
        message = f"{size} bytes; baseline {before} bytes"
    return Finding(
        kind="budget",
        passed=passed,
        value=float(size),
        limit=limit,
        message=message if passed else f"{message}; {UPDATE_REMEDY}",
    )


def budget_limit_ms(budget: Budget, entry: BaselineTime) -> float:
    """Return the limit of a stage's time, milliseconds."""
    return entry.median_ms * (1.0 + budget.rel)


def require_sane_budget(budget: Budget, entry: BaselineTime) -> None:
    """Refuse a budget that a stage of twice its time would keep.

    Raises
    ------
    InputError
        When twice the low end of the baseline's spread is under the limit.
    """
    limit = budget_limit_ms(budget, entry)
    if SLOWDOWN * entry.low_ms <= limit:
        raise InputError(
            f"twice the time would pass: {SLOWDOWN:g} x {entry.low_ms:.4g} ms <= {limit:.4g} ms",
            f"budget of {budget.stage}",
            "narrow rel, or time more repeats on a quieter machine",
        )
