"""One record against one gate: every check becomes a verdict, none stops the others."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final, Protocol

from experiments.errors import (
    EXIT_BAD_INPUT,
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_MACHINERY,
    InputError,
    MachineryError,
)
from experiments.gate.baseline import Baseline
from experiments.gate.budget import check_budget, check_memory
from experiments.gate.display import check_display, is_display_referred
from experiments.gate.finding import Finding
from experiments.gate.identity import check_finite, check_identity, require_as_asked
from experiments.gate.kinds import check_metric
from experiments.gate.noise import check_noise
from experiments.gate.specification import GateSpec
from reports.junit import Verdict
from reports.record import Record

ERROR: Final = "error"
"""Kind of a verdict about the machinery: nothing was decided."""
REFUSED: Final = "refused"
"""Kind of a verdict about the input: a tolerance, a metric or a file that cannot be used."""
VOXEL_MEMORY: Final = "memory of the voxels"
"""What the verdict on a memory budget is about."""
UPDATE_COMMAND: Final = "vctgi gate --update --reason TEXT"


class Gated(Protocol):
    """What a verdict names: a gate, and what it is filed under."""

    @property
    def name(self) -> str:
        """Name of the gate."""

    @property
    def scene(self) -> str:
        """The scene, or the study."""


def evaluate(
    record: Record,
    record_path: Path,
    gate: GateSpec,
    baseline: Baseline | None,
    *,
    update_command: str = UPDATE_COMMAND,
) -> list[Verdict]:
    """Judge a record by its gate.

    Parameters
    ----------
    record, record_path
        What was measured; pictures are found relative to the path's folder.
    gate
        What it is held to.
    baseline
        What it is compared with. None fails, and only what needs no baseline is checked.
    update_command
        What to type to make a baseline.

    Returns
    -------
    list of Verdict
        In the order finite, noise, exact, metrics, budgets. A check that could not be made gives a
        verdict of kind `error` (machinery) or `refused` (input) instead of raising.
    """
    judge = partial(verdict_of, gate)
    verdicts = [judge("pictures", partial(check_finite, record, record_path))]
    asked = judge("request", partial(_as_asked, record, gate))
    if not asked.passed:
        return [*verdicts, asked]
    checks: list[tuple[str, Callable[[], Finding | None]]] = [
        ("noise", partial(check_noise, record, gate))
    ]
    if baseline is None:
        checks.append(("baseline", partial(missing_baseline, update_command)))
    else:
        checks += [(n, partial(_found, f)) for n, f in check_identity(record, baseline).items()]
        if any(is_display_referred(metric_gate.metric) for metric_gate in gate.metrics):
            checks.append(("display", partial(check_display, record, baseline)))
    for metric_gate in gate.metrics:
        item = f"{metric_gate.metric} of {metric_gate.component}"
        checks.append((item, partial(check_metric, metric_gate, record, baseline)))
    if baseline is not None:
        for budget in gate.budgets:
            item = f"time of {budget.stage}"
            checks.append((item, partial(check_budget, budget, record, baseline)))
        if gate.memory is not None:
            checks.append((VOXEL_MEMORY, partial(check_memory, gate.memory, record, baseline)))
    for item, check in checks:
        verdict = verdict_or_none(gate, item, check)
        if verdict is not None:
            verdicts.append(verdict)
    return verdicts


def exit_code(verdicts: Sequence[Verdict]) -> int:
    """Exit code of a list of verdicts.

    A true failure is the strongest news and wins; then what the user must mend; then the
    machinery, which a second run may mend.
    """
    failed = {verdict.kind for verdict in verdicts if not verdict.passed}
    if failed - {ERROR, REFUSED}:
        return EXIT_FAILED
    if REFUSED in failed:
        return EXIT_BAD_INPUT
    return EXIT_MACHINERY if ERROR in failed else EXIT_DONE


def verdict_of(gate: Gated, item: str, check: Callable[[], Finding]) -> Verdict:
    """Make one check and tie its finding to a gate; see `evaluate` for checks that raise."""
    verdict = verdict_or_none(gate, item, check)
    assert verdict is not None, f"the check of {item} found nothing"
    return verdict


def failed_verdict(gate: Gated, item: str, error: Exception, seconds: float) -> Verdict:
    """Turn what a check or a render raised into a verdict of kind `refused` or `error`."""
    is_input = isinstance(error, InputError)
    expected = isinstance(error, InputError | MachineryError)
    return Verdict(
        gate=f"{gate.name}: {item}",
        scene=gate.scene,
        kind=REFUSED if is_input else ERROR,
        passed=False,
        value=None,
        limit="",
        message=str(error) if expected else f"{type(error).__name__}: {error}",
        seconds=seconds,
    )


def verdict_or_none(gate: Gated, item: str, check: Callable[[], Finding | None]) -> Verdict | None:
    """`verdict_of` for a check that may have nothing to say."""
    start = time.perf_counter()
    try:
        finding = check()
    except (InputError, MachineryError) as error:
        return failed_verdict(gate, item, error, time.perf_counter() - start)
    if finding is None:
        return None
    return Verdict(
        gate=f"{gate.name}: {item}",
        scene=gate.scene,
        kind=finding.kind,
        passed=finding.passed,
        value=finding.value,
        limit=finding.limit,
        message=finding.message,
        seconds=time.perf_counter() - start,
    )


def _found(finding: Finding) -> Finding:
    return finding


def _as_asked(record: Record, gate: GateSpec) -> Finding:
    require_as_asked(record, gate)
    asked = f"preset {gate.preset}, {gate.width}x{gate.height}, {gate.reference_spp} reference spp"
    return Finding(kind="exact", passed=True, value=None, limit=asked, message="as asked")


def missing_baseline(update_command: str) -> Finding:
    """Fail for want of a baseline, and say how one is made."""
    return Finding(
        kind="baseline",
        passed=False,
        value=None,
        limit="a reviewed baseline in git",
        message=f"there is no baseline; make one, review it and commit it: {update_command}",
    )
