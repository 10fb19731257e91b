"""Writing and reading records: one JSON file each, append-only, pictures beside it.

Everything that a user of records needs is importable from here.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

from pydantic import ValidationError

from reports.image_files import checked_image_path, publish_once, unused_name_beside
from reports.image_files import load_image as load_image
from reports.image_files import write_image as write_image
from reports.schema import SCHEMA_VERSION as SCHEMA_VERSION
from reports.schema import Display as Display
from reports.schema import FrameCost as FrameCost
from reports.schema import ImageFile as ImageFile
from reports.schema import Interval as Interval
from reports.schema import Machine as Machine
from reports.schema import MetricValue as MetricValue
from reports.schema import NoiseFloor as NoiseFloor
from reports.schema import PlanEntry as PlanEntry
from reports.schema import Record as Record
from reports.schema import ReferenceInfo as ReferenceInfo
from reports.schema import SceneInfo as SceneInfo
from reports.schema import StageTime as StageTime


def write_record(record: Record, directory: Path) -> Path:
    """Write `<directory>/<record_id>.json`; the file is there whole or not at all.

    Parameters
    ----------
    record
        Its images must have been written below `directory` already.
    directory
        Folder of records; made when missing.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ValueError
        When a record of this id exists (records are append-only), or an image of it is missing
        or is not the one whose checksum the record holds.
    """
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / f"{record.record_id}.json"
    for name in record.images:
        checked_image_path(path, record, name)
    temporary = unused_name_beside(path)
    try:
        with temporary.open("x", encoding="utf-8") as file:
            file.write(record.model_dump_json(indent=2) + "\n")
            file.flush()
            os.fsync(file.fileno())
        publish_once(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def read_record(path: Path) -> Record:
    """Read one record; its images are checked when `load_image` reads them.

    Raises
    ------
    ValueError
        When the file is missing, not JSON, of another schema version, or not a record.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ValueError(f"{path}: cannot read the record ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path}: broken record, not UTF-8 text at byte {error.start}; make it again"
        ) from error
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(
            f"{path}: broken record, not JSON at line {error.lineno}, column {error.colno} "
            f"({error.msg}); delete it and make it again"
        ) from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: not a record: its JSON is no object; give a record file")
    version = content.get("schema_version")
    if version != SCHEMA_VERSION:
        raise ValueError(
            f"{path}: schema version {version!r}, but this program reads {SCHEMA_VERSION}; make "
            "the record again with this version, or read it with the version that wrote it"
        )
    try:
        return Record.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "record"
        raise ValueError(
            f"{path}: broken record at {where}: {first['msg']} "
            f"({error.error_count()} fault(s) in all); make it again"
        ) from error


def read_records(directory: Path) -> dict[Path, Record]:
    """Read every record of a folder (`*.json`, not its subfolders), in the order of file names.

    Returns
    -------
    dict
        Record by the path of its file, which `load_image` needs.

    Raises
    ------
    ValueError
        When the folder is missing or a record in it is broken.
    """
    if not directory.is_dir():
        raise ValueError(f"{directory}: no such folder of records; make one with `vctgi report`")
    paths = sorted(path for path in directory.glob("*.json") if not path.name.startswith("."))
    return {path: read_record(path) for path in paths}
