"""A sweep's folder, and how a finished record gets from its attempt to all the others.

ledger.sqlite
records/ID.json, records/ID/*.exr        published: what pages and tables are made of
jobs/KEY/job.json                        what the job's process is given
jobs/KEY/lock                            held while any process works on the job
jobs/KEY/attempt-1.log                   all that the attempt said
jobs/KEY/attempt-1/records/ID.json       receipt: the record was finished, published or not
sweeps/OWNER.lock                        held by a sweep that lives
"""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

from reports.image_files import checked_image_path
from reports.record import read_record

KEY_DIGITS = 20
"""Hexadecimal digits of a key that name a job's folder."""


class SweepFolder:
    """Names of everything that a sweep keeps.

    Parameters
    ----------
    root
        The folder; must be one file system, and shared by all machines that run its jobs.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.ledger = root / "ledger.sqlite"
        self.records = root / "records"

    def owner_lock(self, owner: str) -> Path:
        """Lock file of a sweep."""
        return self.root / "sweeps" / f"{owner}.lock"

    def job(self, key: str) -> Path:
        """Folder of a job."""
        return self.root / "jobs" / key[:KEY_DIGITS]

    def job_file(self, key: str) -> Path:
        """File that the job's process is given."""
        return self.job(key) / "job.json"

    def job_lock(self, key: str) -> Path:
        """Lock file of a job."""
        return self.job(key) / "lock"

    def attempt(self, key: str, number: int) -> Path:
        """Folder that an attempt may write to."""
        return self.job(key) / f"attempt-{number}"

    def log(self, key: str, number: int) -> Path:
        """All that an attempt said."""
        return self.job(key) / f"attempt-{number}.log"

    def finished(self, key: str) -> Path | None:
        """Return the record that an attempt at a job has finished, published or not.

        A record is written after its pictures, and appears whole: where there is one, it is
        finished, whatever became of the process that made it.
        """
        found = sorted(self.job(key).glob("attempt-*/records/*.json"))
        return next((path for path in found if not path.name.startswith(".")), None)

    def clear_attempts(self, key: str) -> None:
        """Remove what attempts left behind, but not what they said."""
        for path in self.job(key).glob("attempt-*"):
            if path.is_dir():
                shutil.rmtree(path)

    def publish(self, receipt: Path) -> Path:
        """Move a finished record among the others; killed at any point, it can be done again.

        The pictures go first and the record last, as when it was written. The receipt stays: it
        is the same file, not a copy.

        Returns
        -------
        Path
            The record.

        Raises
        ------
        ValueError
            The record is broken, or a picture of it is missing or altered.
        """
        record = read_record(receipt)
        self.records.mkdir(parents=True, exist_ok=True)
        target = self.records / receipt.name
        if target.exists():
            return target
        pictures = self.records / record.record_id
        with contextlib.suppress(FileNotFoundError):
            (receipt.parent / record.record_id).rename(pictures)
        for name in record.images:
            checked_image_path(target, record, name)
        with contextlib.suppress(FileExistsError):
            os.link(receipt, target)
        return target
