"""`vctgi results`: tables and pages from records that are there already; renders nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from experiments.errors import EXIT_DONE, InputError

results = App(
    name="results",
    help="Tables and pages from the records of a folder, without rendering.",
    result_action="return_value",
)


@results.command
def export(
    folder: Path,
    *,
    output: Annotated[
        Path, Parameter(name=["--output", "-o"], help="Table: a .parquet or a .csv file.")
    ],
) -> int:
    """Write one row for each metric of each record, with the job's parameters as columns.

    FOLDER is that of a sweep or a report. Parquet needs the extra 'store'; CSV does not.
    """
    from experiments.session import writable_file
    from experiments.sweep.export import SUFFIXES, metric_rows, write_table

    if output.suffix not in SUFFIXES:
        raise InputError(
            f"'{output}' is no name of a table", "--output", f"end it in {' or '.join(SUFFIXES)}"
        )
    rows = metric_rows(folder)
    write_table(rows, writable_file(output))
    records = len({row["record"] for row in rows})
    print(f"{output}: {len(rows)} metrics of {records} records")  # noqa: T201 - the result
    return EXIT_DONE


@results.command
def page(
    folder: Path,
    *,
    output: Annotated[
        Path | None,
        Parameter(name=["--output", "-o"], help="HTML file; left out: index.html in FOLDER."),
    ] = None,
) -> int:
    """Write the page of `vctgi report` about the records of a folder."""
    from experiments.session import writable_file
    from experiments.sweep.export import record_files
    from reports.accuracy import write_accuracy_report

    paths = list(record_files(folder))
    target = writable_file(folder / "index.html" if output is None else output)
    try:
        written = write_accuracy_report(paths, target)
    except ValueError as error:
        raise InputError(
            " ".join(str(error).split()), str(folder), "make that record again"
        ) from error
    print(written)  # noqa: T201 - the command's result
    return EXIT_DONE
