"""Which jobs are waiting, running, done or set aside: one SQLite file, one transaction a change.

Losing any row, or all of them, loses no work: what is finished is found again by its record.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from experiments.errors import InputError

State = Literal["waiting", "running", "done", "set aside"]

LEDGER_VERSION: Final = 1
"""Raised by one whenever an older program would misread the table."""

BUSY_SECONDS: Final = 30.0
"""A transaction takes milliseconds; another sweep's may be waited for so long."""

RETRY_SECONDS: Final = 0.02
"""Between two tries where SQLite does not wait by itself."""

_TABLE: Final = """
CREATE TABLE IF NOT EXISTS jobs (
    key TEXT PRIMARY KEY,
    label TEXT NOT NULL,
    parameters TEXT NOT NULL,           -- JSON
    state TEXT NOT NULL DEFAULT 'waiting',
    attempt INTEGER NOT NULL DEFAULT 0, -- times that it was started
    failures INTEGER NOT NULL DEFAULT 0,-- of those, ended by its own fault
    not_before REAL NOT NULL DEFAULT 0, -- seconds since 1970
    lease TEXT,                         -- the sweep that runs it
    host TEXT,
    pid INTEGER,                        -- of that sweep
    seconds REAL,                       -- of the attempt that finished it, where known
    record TEXT,                        -- relative to the sweep's folder
    error TEXT                          -- last line of the last attempt that failed
) STRICT
"""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A job that this sweep may run."""

    key: str
    label: str
    attempt: int
    """From 1, counting every start."""
    failures: int
    """Attempts before this one that ended by their own fault."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A job that was set aside."""

    key: str
    label: str
    attempt: int
    error: str


class SweepLedger:
    """The table of one folder as one sweep sees it: only the jobs that it was given.

    Parameters
    ----------
    path
        The file; made when missing.
    owner
        Name of this sweep.
    host, pid
        Where it runs, for people who look into the table.
    """

    def __init__(self, path: Path, owner: str, host: str = "", pid: int = 0) -> None:
        self._owner, self._host, self._pid = owner, host, pid
        self._base = sqlite3.connect(path, timeout=BUSY_SECONDS, isolation_level=None)
        try:
            self._open(path)
        except BaseException:
            self._base.close()
            raise

    def _open(self, path: Path) -> None:
        try:
            self._write_ahead()
            # A change that a power cut takes back is found again by its record
            self._base.execute("PRAGMA synchronous = NORMAL")
            self._base.execute("PRAGMA temp_store = MEMORY")
            self._base.execute("CREATE TEMP TABLE wanted (key TEXT PRIMARY KEY, number INTEGER)")
            with self._transaction():
                version = self._base.execute("PRAGMA user_version").fetchone()[0]
                if version not in (0, LEDGER_VERSION):
                    raise InputError(
                        what=f"the ledger is of version {version}, and not {LEDGER_VERSION}",
                        where=str(path),
                        remedy="give --output another folder",
                    )
                self._base.execute(_TABLE)
                self._base.execute(f"PRAGMA user_version = {LEDGER_VERSION}")
        except sqlite3.DatabaseError as error:
            if isinstance(error, sqlite3.OperationalError):
                raise
            raise InputError(
                what=f"the ledger cannot be read ({error})",
                where=str(path),
                remedy="delete it: finished records beside it are taken up again",
            ) from error

    def _write_ahead(self) -> None:
        """Log writes ahead; SQLite does not wait for another sweep that begins to, so this does."""
        end = time.monotonic() + BUSY_SECONDS
        while True:
            try:
                self._base.execute("PRAGMA journal_mode = WAL")
            except sqlite3.OperationalError as error:
                if "locked" not in str(error) or time.monotonic() > end:
                    raise
                time.sleep(RETRY_SECONDS)
            else:
                return

    def close(self) -> None:
        """Let go of the file."""
        self._base.close()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._base.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._base.execute("COMMIT")
        except BaseException:
            # SQLite may have rolled back by itself, as where the disk is full
            if self._base.in_transaction:
                self._base.execute("ROLLBACK")
            raise

    def want(self, jobs: Mapping[str, tuple[str, Mapping[str, Any]]]) -> None:
        """Say which jobs this sweep is about: label and parameters by key, in order."""
        rows = [(key, label, json.dumps(about)) for key, (label, about) in jobs.items()]
        with self._transaction():
            self._base.executemany(
                "INSERT OR IGNORE INTO jobs (key, label, parameters) VALUES (?, ?, ?)", rows
            )
            self._base.executemany(
                "INSERT OR IGNORE INTO wanted VALUES (?, ?)",
                [(key, number) for number, key in enumerate(jobs)],
            )

    def claim(self, now: float) -> Claim | None:
        """Take the next waiting job whose time has come, or None."""
        with self._transaction():
            row = self._base.execute(
                "SELECT key, label, attempt, failures FROM jobs JOIN wanted USING (key)"
                " WHERE state = 'waiting' AND not_before <= ? ORDER BY failures, number LIMIT 1",
                (now,),
            ).fetchone()
            if row is None:
                return None
            key, label, attempt, failures = row
            self._base.execute(
                "UPDATE jobs SET state = 'running', attempt = attempt + 1, lease = ?, host = ?,"
                " pid = ? WHERE key = ?",
                (self._owner, self._host, self._pid, key),
            )
        return Claim(key=key, label=label, attempt=attempt + 1, failures=failures)

    def finish(self, key: str, record: str, seconds: float | None) -> None:
        """Close a job of ours: its record is among the others; None if its time is not known."""
        self._settle(
            key, "state = 'done', record = ?, seconds = ?, error = NULL", (record, seconds)
        )

    def fail(self, key: str, error: str, not_before: float, most_failures: int) -> State:
        """Charge a job of ours with a failure; it waits for the next attempt or is set aside."""
        self._settle(
            key,
            "failures = failures + 1, error = ?, not_before = ?,"
            " state = CASE WHEN failures + 1 >= ? THEN 'set aside' ELSE 'waiting' END",
            (error, not_before, most_failures),
        )
        row = self._base.execute("SELECT state FROM jobs WHERE key = ?", (key,)).fetchone()
        state: State = row[0]
        return state

    def give_back(self, key: str, not_before: float, *, is_started: bool = True) -> None:
        """Let a job of ours wait, without a charge."""
        change = "state = 'waiting', not_before = ?, attempt = attempt - ?"
        self._settle(key, change, (not_before, 0 if is_started else 1))

    def _settle(self, key: str, change: str, values: tuple[object, ...]) -> None:
        with self._transaction():
            self._base.execute(
                f"UPDATE jobs SET {change}, lease = NULL, host = NULL, pid = NULL"
                " WHERE key = ? AND state = 'running' AND lease = ?",
                (*values, key, self._owner),
            )

    def release(self, is_alive: Callable[[str], bool]) -> int:
        """Let the jobs of sweeps that died wait again, without a charge; return how many."""
        owners = self._base.execute(
            "SELECT DISTINCT lease FROM jobs WHERE state = 'running' AND lease <> ?",
            (self._owner,),
        ).fetchall()
        dead = [(owner,) for (owner,) in owners if not is_alive(owner)]
        if not dead:
            return 0
        with self._transaction():
            return self._base.executemany(
                "UPDATE jobs SET state = 'waiting', lease = NULL, host = NULL, pid = NULL"
                " WHERE state = 'running' AND lease = ?",
                dead,
            ).rowcount

    def reopen(self, key: str) -> None:
        """Let a job that was done or set aside wait again, as if it had never failed."""
        with self._transaction():
            self._base.execute(
                "UPDATE jobs SET state = 'waiting', failures = 0, not_before = 0, record = NULL"
                " WHERE key = ? AND state IN ('done', 'set aside')",
                (key,),
            )

    def counts(self) -> dict[State, int]:
        """Return how many of the jobs are in each state."""
        found: dict[State, int] = {"waiting": 0, "running": 0, "done": 0, "set aside": 0}
        found.update(
            self._base.execute(
                "SELECT state, COUNT(*) FROM jobs JOIN wanted USING (key) GROUP BY state"
            ).fetchall()
        )
        return found

    def done(self) -> dict[str, str]:
        """Return the records of jobs that are done, by key."""
        return dict(
            self._base.execute(
                "SELECT key, record FROM jobs JOIN wanted USING (key) WHERE state = 'done'"
            ).fetchall()
        )

    def set_aside(self) -> list[Failure]:
        """Return the jobs that were set aside."""
        rows = self._base.execute(
            "SELECT key, label, attempt, error FROM jobs JOIN wanted USING (key)"
            " WHERE state = 'set aside' ORDER BY number"
        ).fetchall()
        return [
            Failure(key=key, label=label, attempt=attempt, error=error or "")
            for key, label, attempt, error in rows
        ]


def job_parameters(path: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters of finished jobs by the name of their record's file; reads only."""
    if not path.is_file():
        return {}
    with contextlib.closing(sqlite3.connect(path, timeout=BUSY_SECONDS)) as base:
        base.execute("PRAGMA query_only = ON")
        rows = base.execute(
            "SELECT key, record, parameters FROM jobs WHERE state = 'done'"
        ).fetchall()
    return {Path(record).name: {"key": key, **json.loads(text)} for key, record, text in rows}
