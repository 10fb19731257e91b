"""Finished rows on disk, so that work survives a kill: JSON lines, each flushed when it is done."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from experiments.studies.check import Check, Measured

SOURCE_FOLDER = Path(__file__).resolve().parents[2]
"""Where the packages lie."""

COUNTED_PACKAGES = ("vctgi", "reference", "metrics", "experiments")
"""Packages whose sources decide a study's numbers."""

COUNTED_SUFFIXES = (".py", ".toml")
"""Their sources, and presets in files."""


class Ledger:
    """The finished rows of one study, found again by what they depend on.

    Parameters
    ----------
    file
        Where the rows are kept; made when the first is added.
    circumstances
        What all rows depend on beside the code: back end, size of the study.
    """

    def __init__(self, file: Path, circumstances: str) -> None:
        self._file = file
        self._code = f"{code_digest()} {circumstances}"

    def find(self, check: Check) -> Measured | None:
        """Return the last number that was kept for a check, if the code is still the same."""
        return self._read().get(self._key(check))

    def add(self, check: Check, measured: Measured) -> None:
        """Keep a number."""
        self._file.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps({"key": self._key(check), "name": check.name, **asdict(measured)})
        with self._file.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())

    def _key(self, check: Check) -> str:
        parts = (self._code, check.name, check.configuration, check.scene)
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _read(self) -> dict[str, Measured]:
        if not self._file.is_file():
            return {}
        rows = {}
        for line in self._file.read_text(encoding="utf-8").splitlines():
            try:
                row = json.loads(line)
                numbers = {name: row[name] for name in ("value", "low", "high")}
                found = Measured(**numbers, note=row.get("note", ""))
                rows[row["key"]] = found
            except (json.JSONDecodeError, KeyError, TypeError):
                continue  # a line that a kill cut short
        return rows


def code_digest() -> str:
    """Return a hash of the sources and versions that a study's numbers come from."""
    digest = hashlib.sha256()
    for package in COUNTED_PACKAGES:
        for suffix in COUNTED_SUFFIXES:
            for path in sorted((SOURCE_FOLDER / package).rglob(f"*{suffix}")):
                digest.update(str(path.relative_to(SOURCE_FOLDER)).encode())
                digest.update(path.read_bytes())
    for package in ("mitsuba", "drjit", "numpy"):
        digest.update(version(package).encode())
    return digest.hexdigest()
