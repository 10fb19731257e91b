"""The study gates of a file: measure, compare or update."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from experiments.errors import InputError
from experiments.gate.evaluation import verdict_of
from experiments.gate.finding import Finding
from experiments.gate.study_baseline import (
    read_study_baseline,
    study_baseline_from,
    study_baseline_path,
)
from experiments.gate.study_evaluation import (
    evaluate_study,
    failed_study,
    require_mutant_fails,
)
from experiments.gate.study_mutants import check_study_mutants
from experiments.gate.study_specification import StudyGate
from experiments.gate.update import refuse_failing, write_model
from reports.junit import Verdict
from reports.study_record import StudyRecord

MeasureStudy = Callable[[StudyGate, Sequence[str]], StudyRecord]
"""Measures the checks of these names of the study that a gate asks for."""


def not_measured(gate: StudyGate, names: Sequence[str]) -> StudyRecord:
    """Measure nothing, where a caller brings no way to.

    Raises
    ------
    InputError
        Always.
    """
    raise InputError(
        f"{len(names)} numbers of a study are asked for", f"gate {gate.name}", "use `vctgi gate`"
    )


def judge_study(
    gate: StudyGate,
    measure: MeasureStudy,
    folder: Path,
    update_command: str,
    *,
    update_reason: str | None = None,
    mutants: bool = False,
) -> list[Verdict]:
    """Measure what a gate asks for, and compare it or make a baseline of it.

    Parameters
    ----------
    gate, measure
        What is asked for, and what measures it. What it raises is the verdict of that gate.
    folder
        Where baselines are.
    update_command
        What to type to make them.
    update_reason
        Given: write the baseline with this reason instead of comparing.
    mutants
        Also measure the planted faults, and demand that each is caught.
    """
    start = time.perf_counter()
    names = gate.needed
    if mutants or update_reason is not None:
        names = names + gate.planted
    try:
        record = measure(gate, names)
    except Exception as error:  # one gate must not end the others
        return [failed_study(gate, error, time.perf_counter() - start)]
    path = study_baseline_path(folder, gate, record.machine.backend)
    if update_reason is not None:
        return [verdict_of(gate, "baseline", partial(_update, gate, record, path, update_reason))]
    try:
        baseline = read_study_baseline(path)
        verdicts = evaluate_study(record, gate, baseline, update_command=update_command)
        if mutants and baseline is not None:
            verdicts += check_study_mutants(record, gate, baseline)
    except InputError as error:
        return [failed_study(gate, error, time.perf_counter() - start)]
    return verdicts


def _update(gate: StudyGate, record: StudyRecord, path: Path, reason: str) -> Finding:
    """Write a baseline; refuse numbers that would fail at once, and tolerances that gate nothing.

    Raises
    ------
    InputError, MachineryError
        As `update_baselines`.
    """
    baseline = study_baseline_from(gate, record, reason.strip())
    for entry in baseline.numbers:
        require_mutant_fails(entry)
    refuse_failing(evaluate_study(record, gate, baseline))
    write_model(path, baseline)
    return Finding(
        kind="update", passed=True, value=None, limit="a reason", message=f"wrote {path}: {reason}"
    )
