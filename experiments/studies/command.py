"""`vctgi study`: measure, print a table as the numbers come, say whether all pass."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import cast

from experiments.errors import EXIT_DONE, EXIT_FAILED, EXIT_MACHINERY
from experiments.machine import BackendName, describe_machine
from experiments.progress import ProgressReport
from experiments.session import start_mitsuba, writable_file, writable_folder
from experiments.studies.catalogue import STUDIES, checks_of, find_study, select_checks
from experiments.studies.check import StudyContext
from experiments.studies.ledger import Ledger
from experiments.studies.run import run_checks
from experiments.studies.table import head_line, row_line
from reference import default_cache_directory
from reports.study_record import StudyRecord, StudyRow

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
    if output is not None:
        writable_folder(output)
    if json_file is not None:
        writable_file(json_file, "--json")
    kept = writable_folder(cache or default_cache_directory(), "--cache")
    ledger = Ledger(
        kept / "studies" / f"{name}.jsonl", shlex.join([chosen_variant, *options.words])
    )

    rows: list[StudyRow] = []
    stream = _line_writer()
    with ProgressReport() as progress:
        context = StudyContext(
            quick=options.quick, progress=progress, output=output, scene=options.scene
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
    refused = sum(bool(row.refused) for row in rows)
    failed = sum(not row.passed for row in rows) - refused
    stream(
        f"{len(rows) - failed - refused} of {len(rows)} passed"
        + (f", {failed} FAILED" if failed else "")
        + (f", {refused} REFUSED" if refused else "")
    )
    if json_file is not None:
        only = [] if options.only is None else ["--only", options.only]
        command = shlex.join(["vctgi", "study", name, *options.words, *only])
        record = StudyRecord(
            study=name,
            quick=options.quick,
            created=datetime.now(UTC),
            command=command,
            rows=rows,
            machine=describe_machine(cast(BackendName, chosen_variant)),
        )
        json_file.write_text(record.model_dump_json(indent=1) + "\n", encoding="utf-8")
    if failed:
        return EXIT_FAILED
    return EXIT_MACHINERY if refused else EXIT_DONE


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
