"""`vctgi study`: measure, print a table as the numbers come, say whether all pass."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import cast

from experiments.errors import EXIT_DONE, EXIT_FAILED, EXIT_MACHINERY
from experiments.machine import BackendName, describe_machine
from experiments.progress import ProgressReport
from experiments.session import start_mitsuba, writable_file, writable_folder
from experiments.studies.catalogue import (
    STUDIES,
    checks_of,
    definitions_of,
    find_study,
    select_checks,
)
from experiments.studies.check import Check, StudyContext
from experiments.studies.figures import FigureShelf, curves_of
from experiments.studies.ledger import Ledger, code_digest
from experiments.studies.record_folder import RecordFolder
from experiments.studies.run import run_checks
from experiments.studies.table import head_line, row_line
from reference import default_cache_directory
from reports.schema import Machine
from reports.study_record import StudyRecord, StudyRow, record_text

QUICK_NOTE = "This is the quick version: fewer repetitions and points, wider intervals."


def study_titles() -> dict[str, str]:
    """Return the question of each study, by name."""
    return {name: entry.title for name, entry in STUDIES.items()}


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """What of a study is measured, and on what."""

    quick: bool = False
    """The smaller version."""
    only: str | None = None
    """Only checks whose name holds this text."""
    resume: bool = False
    """Numbers that the same code has measured before are kept."""
    scene: str | None = None
    """Scene for the checks that take one."""

    @property
    def words(self) -> list[str]:
        """Return what to type to ask for the same numbers, apart from which."""
        return [
            *(["--quick"] if self.quick else []),
            *(["--scene", self.scene] if self.scene is not None else []),
        ]


def run_study(
    name: str,
    options: StudyOptions,
    *,
    variant: str | None,
    cache: Path | None,
    output: Path | None,
    json_file: Path | None,
) -> int:
    """Run a study and return the exit code.

    1 when a row does not pass; else 3 when one was refused, for its reference is too noisy.

    Raises
    ------
    InputError
        No such study or check, or a file that cannot be written; nothing was measured.
    """
    entry = find_study(name)
    chosen_variant = start_mitsuba(variant)
    known = checks_of(entry)
    chosen = select_checks(known, options.only, quick=options.quick)
    folder = None
    if output is not None:
        folder = RecordFolder(writable_folder(output), name, options.scene)
    if json_file is not None:
        writable_file(json_file, "--json")
    kept = writable_folder(cache or default_cache_directory(), "--cache")
    ledger = Ledger(
        kept / "studies" / f"{name}.jsonl", shlex.join([chosen_variant, *options.words])
    )
    shelf = FigureShelf(None if folder is None else folder.pictures)
    run = _Run(name, options, chosen, shelf, describe_machine(cast(BackendName, chosen_variant)))
    if folder is not None and options.resume:
        shelf.add_all(folder.earlier_figures(run.command, run.code))

    rows: list[StudyRow] = []
    stream = _line_writer()
    with ProgressReport() as progress:
        context = StudyContext(
            quick=options.quick, progress=progress, shelf=shelf, scene=options.scene
        )
        if options.quick:
            stream(f"{QUICK_NOTE} {len(chosen)} of {len(known)} numbers are measured.")
        stream(head_line())
        found = run_checks(
            shlex.join([name, *options.words]), chosen, context, ledger, resume=options.resume
        )
        configuration = ""
        for number, check in enumerate(chosen, start=1):
            progress.start_scene(f"{name}: {check.name}", number, len(chosen))
            row = next(found)
            if row.configuration != configuration:
                configuration = row.configuration
                stream(f"  with {configuration}")
            stream(row_line(row))
            rows.append(row)
            if folder is not None:
                # A run that is killed leaves its figures to be taken up again.
                folder.write(run.record(rows))
    stream(_verdict(rows))
    if json_file is not None:
        json_file.write_text(record_text(run.record(rows)), encoding="utf-8")
    if folder is not None:
        stream(f"page: {folder.write_page()}")
    return _exit_code(rows)


def _verdict(rows: list[StudyRow]) -> str:
    """Say how many rows passed, failed and were refused."""
    refused = sum(bool(row.refused) for row in rows)
    failed = sum(not row.passed for row in rows) - refused
    return (
        f"{len(rows) - failed - refused} of {len(rows)} passed"
        + (f", {failed} FAILED" if failed else "")
        + (f", {refused} REFUSED" if refused else "")
    )


def _exit_code(rows: list[StudyRow]) -> int:
    if any(not row.passed and not row.refused for row in rows):
        return EXIT_FAILED
    return EXIT_MACHINERY if any(row.refused for row in rows) else EXIT_DONE


@dataclass(frozen=True)
class _Run:
    """What a record says of a run beside its rows."""

    study: str
    options: StudyOptions
    chosen: list[Check]
    shelf: FigureShelf
    machine: Machine
    code: str = field(default_factory=code_digest)

    @property
    def command(self) -> str:
        only = [] if self.options.only is None else ["--only", self.options.only]
        return shlex.join(["vctgi", "study", self.study, *self.options.words, *only])

    def record(self, rows: list[StudyRow]) -> StudyRecord:
        """Return the record of the rows that are known so far."""
        entry = find_study(self.study)
        curves = curves_of(rows, {check.name: check.points for check in self.chosen})
        drawn = {curve.key for curve in curves}
        return StudyRecord(
            study=self.study,
            quick=self.options.quick,
            created=datetime.now(UTC),
            command=self.command,
            rows=rows,
            machine=self.machine,
            question=entry.title,
            code=self.code,
            headlines=[check.name for check in self.chosen if check.is_headline],
            figures=[*curves, *(each for each in self.shelf.figures if each.key not in drawn)],
            definitions=definitions_of(entry),
        )


def _line_writer() -> Callable[[str], None]:
    """Return what prints a line of the result at once.

    On a terminal the progress bar has to make room, which `print` lets it do; elsewhere the lines
    go straight to where standard output led before the bar began.
    """
    before = sys.stdout

    def write(line: str) -> None:
        stream = sys.stdout if before.isatty() else before
        stream.write(line + "\n")
        stream.flush()

    return write
