"""Records as one table: a row for each metric of each record, the job's parameters as columns."""

from __future__ import annotations

import csv
import importlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.errors import InputError, MachineryError
from experiments.sweep.folder import SweepFolder
from experiments.sweep.ledger import job_parameters
from reports.record import Record, read_records

Row = dict[str, Any]

SUFFIXES = (".parquet", ".csv")
"""Forms of a table."""


def record_files(folder: Path) -> dict[Path, Record]:
    """Return the records of a folder, or of `records/` in it.

    Raises
    ------
    InputError
        There is none, or one is broken.
    """
    inner = folder / "records"
    try:
        found = read_records(inner if inner.is_dir() else folder)
    except ValueError as error:
        raise InputError(
            what=" ".join(str(error).split()),
            where=str(folder),
            remedy="give the folder of a sweep or of a report",
        ) from error
    if not found:
        raise InputError("no record in it", str(folder), "give the folder of a sweep or a report")
    return found


def metric_rows(folder: Path) -> list[Row]:
    """Return the rows of all records of a folder, all with the same columns in the same order.

    Columns `parameter.NAME` hold the values that a sweep gave to fields of the configuration.
    """
    jobs = job_parameters(SweepFolder(folder).ledger)
    rows: list[Row] = []
    for path, record in record_files(folder).items():
        about = _about(record, jobs.get(path.name, {}))
        for metric in record.metrics:
            interval = metric.interval
            rows.append(
                {
                    **about,
                    "component": metric.component,
                    "metric": metric.name,
                    "value": metric.value,
                    "low": None if interval is None else interval.low,
                    "high": None if interval is None else interval.high,
                    "level": None if interval is None else interval.level,
                    "unit": metric.unit,
                    "ideal": metric.ideal,
                }
            )
    columns = list(dict.fromkeys(column for row in rows for column in row))
    return [{column: row.get(column) for column in columns} for row in rows]


def _about(record: Record, job: Mapping[str, Any]) -> Row:
    """Return what all rows of a record have in common."""
    frame = next((time for time in record.times if time.stage == "frame"), None)
    reference = record.reference
    return {
        "record": record.record_id,
        "job": job.get("key"),
        "created": record.created,
        "scene": record.scene.name,
        "scene_digest": record.scene.digest,
        "preset": job.get("preset", record.preset),
        "configuration": record.preset,
        **{f"parameter.{name}": _plain(value) for name, value in job.get("values", {}).items()},
        "seed": record.seed,
        "width": record.width,
        "height": record.height,
        "reference_spp": None if reference is None else reference.samples_per_pixel,
        "reference_noise_relmse": None if reference is None else reference.noise_relmse,
        "reference_seconds": None if reference is None else reference.seconds,
        "frame_ms": None if frame is None else frame.median_ms,
        "backend": record.machine.backend,
        "device": record.machine.device,
        "commit": record.machine.commit,
        "is_dirty": record.machine.is_dirty,
    }


def _plain(value: Any) -> Any:
    """Return a value that a cell can hold."""
    return json.dumps(value) if isinstance(value, list | dict) else value


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write rows to a `.parquet` or `.csv` file, whole or not at all.

    Raises
    ------
    InputError
        Another ending.
    MachineryError
        Parquet is wanted, and the extra is not installed.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(
            f"'{path.name}' is no name of a table", "--output", f"end it in {' or '.join(SUFFIXES)}"
        )
    temporary = path.with_name(f".{path.name}.part")
    try:
        (_write_parquet if path.suffix == ".parquet" else _write_csv)(rows, temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _write_csv(rows: Sequence[Row], path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]) if rows else [])
        writer.writeheader()
        writer.writerows(rows)


def _write_parquet(rows: Sequence[Row], path: Path) -> None:
    try:
        arrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise MachineryError(
            what=f"Parquet needs pyarrow ({error})",
            where=str(path.with_name(path.name.removeprefix(".").removesuffix(".part"))),
            remedy="pip install 'vctgi[store]', or give a name that ends in .csv",
        ) from error
    columns = {name: _column([row[name] for row in rows]) for name in (rows[0] if rows else {})}
    parquet.write_table(arrow.table(columns), path)


def _column(values: list[Any]) -> list[Any]:
    """Return values of one type: whole numbers beside fractions become these, mixtures text."""
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        return [None if value is None else float(value) for value in values]
    if len(kinds) > 1:
        return [
            value if value is None or isinstance(value, str) else json.dumps(value)
            for value in values
        ]
    return values
