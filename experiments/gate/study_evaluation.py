"""One study against its gate: every check becomes a verdict, none stops the others."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from experiments.errors import InputError, MachineryError
from experiments.gate.evaluation import (
    UPDATE_COMMAND,
    failed_verdict,
    missing_baseline,
    verdict_or_none,
)
from experiments.gate.finding import UPDATE_REMEDY, Finding
from experiments.gate.kinds import check_band, check_same_number
from experiments.gate.order import compare_order, distance_from_ideal
from experiments.gate.scales import (
    Estimate,
    band_text,
    estimate_from_bounds,
    estimate_from_noise,
)
from experiments.gate.study_baseline import (
    StudyBaseline,
    StudyNumber,
    find_row,
    formula_of,
    number_of,
)
from experiments.gate.study_specification import (
    AnyStudyGate,
    StudyAbsolute,
    StudyExact,
    StudyGate,
    StudyOrder,
)
from experiments.gate.tolerance import band_of, decide, margin_of
from reports.junit import Verdict
from reports.study_record import StudyRecord, StudyRow


def evaluate_study(
    record: StudyRecord,
    gate: StudyGate,
    baseline: StudyBaseline | None,
    *,
    update_command: str = UPDATE_COMMAND,
) -> list[Verdict]:
    """Judge the numbers of a study by its gate.

    Parameters
    ----------
    record
        What was measured: at least the checks that the gate needs.
    gate
        What it is held to.
    baseline
        What it is compared with. None fails, and only what needs no baseline is checked.
    update_command
        What to type to make a baseline.

    Returns
    -------
    list of Verdict
        In the order finite, exact, numbers, orders. What could not be decided is a verdict of kind
        `error` or `refused`, as for records.
    """
    checks: list[tuple[str, Callable[[], Finding | None]]] = [
        ("numbers", partial(check_finite_rows, record, gate))
    ]
    if baseline is None:
        checks.append(("baseline", partial(missing_baseline, update_command)))
    else:
        checks.append(("request", partial(_same_request, record, gate, baseline)))
    for each in gate.checks:
        checks.append((each.metric, partial(_check_number, each, record, baseline)))
    for order in gate.orders:
        checks.append((f"order {order.name}", partial(_check_order, order, record)))
    found = (verdict_or_none(gate, item, check) for item, check in checks)
    return [verdict for verdict in found if verdict is not None]


def check_finite_rows(record: StudyRecord, gate: StudyGate) -> Finding:
    """Find numbers that the gate needs and that are none.

    Raises
    ------
    MachineryError
        When a number was refused, such as one below the noise of its reference.
    """
    rows = [find_row(record, name) for name in gate.needed]
    for row in rows:
        if row.refused:
            raise MachineryError(row.refused, row.check, "make its reference less noisy")
    broken = [row.check for row in rows if row.value is None]
    return Finding(
        kind="finite",
        passed=not broken,
        value=float(len(broken)),
        limit="0 numbers that are not finite",
        message=f"not finite: {'; '.join(broken)}" if broken else f"{len(rows)} numbers are finite",
    )


def require_mutant_fails(entry: StudyNumber) -> None:
    """Refuse a tolerance that the planted fault's number would keep to.

    Raises
    ------
    InputError
        It would.
    """
    gate, before = entry.tolerance, entry.estimate()
    if isinstance(gate, StudyExact):
        if entry.mutant == entry.value:
            raise InputError(
                f"with its planted fault ({gate.mutant}) the number is the same, {entry.value:.5g}",
                f"exact gate on {gate.metric}",
                "name a fault that the number shows",
            )
        return
    band = band_of(gate, before)
    where = f"{gate.kind} gate on {gate.metric}"
    noise = gate.noise or 0.0
    planted = estimate_from_noise(gate.scale, entry.mutant, noise, where)
    if decide(planted, band, margin_of(band, before)) != "failed":
        raise InputError(
            f"with its planted fault ({gate.mutant}) the number is {entry.mutant:.5g}, which keeps "
            f"to the limit ({band_text(gate.scale, band)})",
            where,
            "narrow the tolerance, or name a fault that the number shows",
        )


def failed_study(gate: StudyGate, error: Exception, seconds: float) -> Verdict:
    """Return the verdict on a study that could not be measured."""
    return failed_verdict(gate, "measure", error, seconds)


def _same_request(record: StudyRecord, gate: StudyGate, baseline: StudyBaseline) -> Finding:
    """Compare what must be the same for all numbers to be comparable."""
    now = (record.study, record.quick, record.machine.backend)
    asked = (gate.study, gate.quick, baseline.backend)
    if now[:2] != asked[:2]:
        raise MachineryError(
            f"asked for {asked[:2]}, got {now[:2]}", f"gate {gate.name}", "measure what is asked"
        )
    then = (baseline.study, baseline.quick, baseline.backend)
    return Finding(
        kind="exact",
        passed=now == then,
        value=None,
        limit=f"exactly study {then[0]}, quick {then[1]}, {then[2]}",
        message="the same" if now == then else f"got {now}; {UPDATE_REMEDY}",
    )


def _check_number(
    gate: AnyStudyGate, record: StudyRecord, baseline: StudyBaseline | None
) -> Finding | None:
    row = find_row(record, gate.metric)
    if row.value is None:
        return None
    if baseline is None:
        return (
            check_band(gate, number_of(row, gate), None)
            if isinstance(gate, StudyAbsolute)
            else None
        )
    entry = baseline.number_for(gate)
    stale = _stale(gate, row, entry)
    if stale is not None or entry is None:
        return stale
    require_mutant_fails(entry)
    if isinstance(gate, StudyExact):
        return check_same_number(number_of(row, gate), entry)
    return check_band(gate, number_of(row, gate), entry)


def _stale(gate: AnyStudyGate, row: StudyRow, entry: StudyNumber | None) -> Finding | None:
    """Fail when the baseline was reviewed for another gate, configuration or scene."""
    if entry is None:
        limit, message = "a reviewed number", "the baseline has no number for this gate"
    elif entry.tolerance != gate:
        limit = "the tolerance reviewed with the baseline"
        message = "the tolerance or the mutant was changed since the baseline was reviewed"
    elif entry.formula != formula_of(row):
        limit = f"measured with: {entry.formula}"
        message = f"it is now measured with: {formula_of(row)}"
    else:
        return None
    return Finding(
        kind="exact",
        passed=False,
        value=row.value,
        limit=limit,
        message=f"{message}; {UPDATE_REMEDY}",
    )


def _check_order(order: StudyOrder, record: StudyRecord) -> Finding | None:
    rows = [find_row(record, name) for name in (order.better, order.worse)]
    if any(row.value is None for row in rows):
        return None
    near, far = (_badness(order, row) for row in rows)
    value = rows[0].value
    assert value is not None
    return compare_order(order.name, (order.better, near), (order.worse, far), value)


def _badness(order: StudyOrder, row: StudyRow) -> Estimate:
    assert row.value is not None
    where = f"order {order.name}, {row.check}"
    if order.noise is not None:
        estimate = estimate_from_noise(order.scale, row.value, order.noise, where)
    elif row.low is None or row.high is None:
        raise InputError(
            "the number has no interval", where, "set 'noise' to its relative half-width"
        )
    else:
        estimate = estimate_from_bounds(order.scale, row.value, row.low, row.high, where)
    return distance_from_ideal(order.scale, estimate)
