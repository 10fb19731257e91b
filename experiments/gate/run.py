"""All gates of a file: render, compare or update, report, and say it in an exit code."""

from __future__ import annotations

import os
import shlex
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from experiments.errors import InputError, MachineryError
from experiments.gate.baseline import baseline_path, read_baseline
from experiments.gate.determinism import (
    RENDERED_TWICE,
    Files,
    check_planted_rounding,
    check_rendered_twice,
)
from experiments.gate.evaluation import evaluate, exit_code, failed_verdict, verdict_of
from experiments.gate.finding import Finding
from experiments.gate.gates_file import GatesFile, load_gates
from experiments.gate.mutants import check_mutants
from experiments.gate.order import check_order
from experiments.gate.specification import GateSpec
from experiments.gate.study_run import MeasureStudy, judge_study, not_measured
from experiments.gate.summary import github_annotations, markdown_summary
from experiments.gate.update import update_baselines
from reports.junit import Verdict, write_junit
from reports.record import Record

Render = Callable[[GateSpec], tuple[Record, Path]]
"""Renders what a gate asks for; returns the record and its file."""


@dataclass(frozen=True)
class GateRun:
    """What a run over all gates found."""

    verdicts: tuple[Verdict, ...]
    update_command: str

    @property
    def exit_code(self) -> int:
        """0 all passed; else the first that applies of 1 gate failed, 2 input, 3 machinery."""
        return exit_code(self.verdicts)


def run_gate(
    gates_file: Path,
    render: Render,
    measure: MeasureStudy = not_measured,
    *,
    junit: Path | None = None,
    markdown: Path | None = None,
    update_reason: str | None = None,
    mutants: bool = False,
    only: Sequence[str] = (),
) -> int:
    """Check every gate of a file, or update its baselines.

    Writes one line per failed check to stderr and, where the environment has GITHUB_ACTIONS, at
    most ten annotations to stdout.

    Parameters
    ----------
    gates_file
        A `gates.toml`.
    render
        Renders what a gate asks for. What it raises is the verdict of that gate, kind `refused`
        for an InputError and `error` for all else; the other gates go on.
    measure
        Measures what a gate asks of a study, in the same way.
    junit, markdown
        Files to write: all verdicts as JUnit XML; the failures as Markdown.
    update_reason
        Given: write baselines with this reason instead of comparing.
    mutants
        Also plant the mutants of every gate and demand that each is caught.
    only
        Names of the gates to check; none: all.

    Returns
    -------
    int
        Exit code, see `GateRun.exit_code`.

    Raises
    ------
    InputError
        When the gates file cannot be used or the reason is empty: nothing was rendered.
    MachineryError
        When a report cannot be written.
    """
    result = check_gates(
        gates_file, render, measure, update_reason=update_reason, mutants=mutants, only=only
    )
    try:
        if junit is not None:
            write_junit(result.verdicts, junit)
        if markdown is not None:
            markdown.parent.mkdir(parents=True, exist_ok=True)
            text = markdown_summary(result.verdicts, result.update_command)
            markdown.write_text(text, encoding="utf-8")
    except OSError as error:
        raise MachineryError(
            f"cannot write the report ({error.strerror})",
            str(error.filename),
            "choose another path",
        ) from error
    for verdict in result.verdicts:
        if not verdict.passed:
            line = " ".join(f"{verdict.gate} [{verdict.kind}]: {verdict.message}".split())
            sys.stderr.write(f"{line}\n")
    if os.environ.get("GITHUB_ACTIONS"):
        sys.stdout.writelines(f"{line}\n" for line in github_annotations(result.verdicts))
    return result.exit_code


def check_gates(
    gates_file: Path,
    render: Render,
    measure: MeasureStudy = not_measured,
    *,
    update_reason: str | None = None,
    mutants: bool = False,
    only: Sequence[str] = (),
) -> GateRun:
    """Do the work of `run_gate` without writing any report.

    Raises
    ------
    InputError
        When the gates file cannot be used or the reason is empty: nothing was rendered.
    """
    content = load_gates(gates_file)
    if only:
        content = content.only(only)
    if update_reason is not None and not update_reason.strip():
        raise InputError("no reason", "--reason", "say why the new numbers are right")
    command = f"vctgi gate {shlex.quote(str(gates_file))} --update --reason TEXT"
    folder = gates_file.parent / content.baselines
    verdicts: list[Verdict] = []
    records: dict[str, Record] = {}
    for gate in content.gates:
        start = time.perf_counter()
        try:
            record, record_path = render(gate)
        except Exception as error:  # one gate must not end the others
            verdicts.append(failed_verdict(gate, "render", error, time.perf_counter() - start))
            continue
        records[gate.name] = record
        if gate.deterministic:
            again = _rendered_twice(gate, render, (record, record_path), mutants)
            verdicts += again
            if not all(verdict.passed for verdict in again) and update_reason is not None:
                continue
        if update_reason is None:
            verdicts += _compare(gate, record, record_path, folder, command, mutants)
        else:
            update = partial(_update, gate, record, record_path, folder, update_reason)
            verdicts.append(verdict_of(gate, "baseline", update))
    if update_reason is None:
        verdicts += _orders(content, records, mutants)
    for study in content.studies:
        verdicts += judge_study(
            study, measure, folder, command, update_reason=update_reason, mutants=mutants
        )
    return GateRun(tuple(verdicts), command)


def _compare(
    gate: GateSpec,
    record: Record,
    record_path: Path,
    folder: Path,
    update_command: str,
    mutants: bool,
) -> list[Verdict]:
    try:
        baseline = read_baseline(baseline_path(folder, gate, record.machine.backend))
    except InputError as error:
        return [failed_verdict(gate, "baseline", error, 0.0)]
    verdicts = evaluate(record, record_path, gate, baseline, update_command=update_command)
    if mutants and baseline is not None:
        with tempfile.TemporaryDirectory(prefix="vctgi-mutants-") as scratch:
            verdicts += check_mutants(record, record_path, gate, baseline, Path(scratch))
    return verdicts


def _update(
    gate: GateSpec, record: Record, record_path: Path, folder: Path, reason: str
) -> Finding:
    (path,) = update_baselines([(gate, record, record_path)], folder, reason)
    return Finding(
        kind="update", passed=True, value=None, limit="a reason", message=f"wrote {path}: {reason}"
    )


def _rendered_twice(gate: GateSpec, render: Render, first: Files, mutants: bool) -> list[Verdict]:
    """Render a gate's scene once more: the pictures must be the same, and rounding be noticed."""
    start = time.perf_counter()
    try:
        second = render(gate)
    except Exception as error:  # as for the first render
        return [failed_verdict(gate, "render", error, time.perf_counter() - start)]
    check = partial(check_rendered_twice, first, second)
    verdicts = [verdict_of(gate, RENDERED_TWICE, check)]
    if mutants:
        planted = partial(check_planted_rounding, *second)
        verdicts.append(
            mutant_verdict(gate, "one value moved by rounding", RENDERED_TWICE, planted)
        )
    return verdicts


def mutant_verdict(gate: GateSpec, name: str, item: str, check: Callable[[], Finding]) -> Verdict:
    """Demand that a check of something with a planted fault fails."""
    found = verdict_of(gate, item, check)
    return Verdict(
        gate=f"{gate.name}: {name}",
        scene=gate.scene,
        kind="mutant",
        passed=not found.passed,
        value=None,
        limit=f"{item} fails",
        message="this fault was let through" if found.passed else found.message,
        seconds=found.seconds,
    )


def _orders(content: GatesFile, records: dict[str, Record], mutants: bool) -> list[Verdict]:
    """Compare pairs of records; a pair whose render failed has its verdict there already."""
    gates = {gate.name: gate for gate in content.gates}
    verdicts = []
    for order in content.orders:
        if order.better in records and order.worse in records:
            check = partial(check_order, order, records[order.better], records[order.worse])
            gate, item = gates[order.better], f"order {order.name}"
            verdicts.append(verdict_of(gate, item, check))
            if mutants:
                swapped = partial(check_order, order, records[order.worse], records[order.better])
                verdicts.append(mutant_verdict(gate, f"{item} swapped", item, swapped))
    return verdicts
