"""Finished evaluations on disk, so that a fit that was killed goes on.

It ends where it would have. Append-only lines of JSON. Optimisers are deterministic: started again
they ask for the same evaluations, find those that are kept, and go on with the first that is not.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

Row = dict[str, Any]
"""What an evaluation found, as JSON holds it: floats come back to the last bit."""


class EvaluationLedger:
    """The evaluations in one file.

    Parameters
    ----------
    file
        Where they are kept; made with the first.
    circumstances
        What all of them depend on: code, versions, back end.

    Attributes
    ----------
    reused_count
        Evaluations that were found instead of made.
    """

    def __init__(self, file: Path, circumstances: str) -> None:
        self._file = file
        self._circumstances = circumstances
        self._rows = _read(file)
        self.reused_count = 0

    def find(self, *parts: str) -> Row | None:
        """Return what is kept of an evaluation, or None."""
        found = self._rows.get(self._key(parts))
        self.reused_count += found is not None
        return found

    def add(self, row: Row, *parts: str) -> None:
        """Keep an evaluation; when this returns, it is on disk.

        Parameters
        ----------
        row
            What was found.
        parts
            What it depends on: scene, configuration, seed, kind.
        """
        key = self._key(parts)
        self._rows[key] = row
        self._file.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps({"key": key, "row": row}) + "\n"
        with self._file.open("ab+") as file:
            # A kill may have left half a line.
            if file.seek(0, os.SEEK_END) > 0:
                file.seek(-1, os.SEEK_END)
                line = line if file.read(1) == b"\n" else "\n" + line
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())

    def _key(self, parts: tuple[str, ...]) -> str:
        return hashlib.sha256("\n".join((self._circumstances, *parts)).encode()).hexdigest()


def _read(file: Path) -> dict[str, Row]:
    if not file.is_file():
        return {}
    rows = {}
    for line in file.read_text(encoding="utf-8").splitlines():
        try:
            found = json.loads(line)
            rows[found["key"]] = found["row"]
        except (json.JSONDecodeError, KeyError, TypeError):
            continue  # a line that a kill cut short
    return rows
