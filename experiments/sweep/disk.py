"""Telling a full disk from other failures: it is nobody's fault, and the sweep stops cleanly."""

from __future__ import annotations

import errno
import os
import sqlite3
import tempfile
from pathlib import Path
from typing import Final

from experiments.errors import MachineryError

FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""No space, no quota, or a limit on the size of files."""

EXIT_DISK_FULL: Final = 74
"""Exit code of a job's process that met a full disk, EX_IOERR of sysexits.h; only sweeps see it."""

LEAST_ROOM: Final = 32 * 2**20
"""Bytes that a failed job's disk must still hold for the failure to be the job's own: libraries
that write pictures do not always say why they could not."""


class DiskFullError(MachineryError):
    """The sweep's disk is full."""

    def __init__(self, folder: Path) -> None:
        super().__init__(
            what="the disk is full",
            where=str(folder),
            remedy="make room and give the same command again: it goes on where it stopped",
        )

    def __reduce__(self) -> tuple[type[DiskFullError], tuple[Path]]:
        """Cross from process to process."""
        return DiskFullError, (Path(self.where),)


def is_disk_full(error: BaseException) -> bool:
    """Whether an error of a file or of the ledger, or its cause, says that the disk is full."""
    if isinstance(error, OSError) and error.errno in FULL:
        return True
    if isinstance(error, sqlite3.Error):
        code = getattr(error, "sqlite_errorcode", None)
        if code is not None and code & 0xFF == sqlite3.SQLITE_FULL:
            return True
    cause = error.__cause__ or error.__context__
    return cause is not None and is_disk_full(cause)


def blames_disk(error: BaseException, folder: Path) -> bool:
    """Whether an error comes of a full disk.

    SQLite calls some of the reasons, such as a quota, only an input or output error; then it is
    tried whether the folder takes more.
    """
    if is_disk_full(error):
        return True
    code = getattr(error, "sqlite_errorcode", 0) if isinstance(error, sqlite3.Error) else 0
    return code & 0xFF == sqlite3.SQLITE_IOERR and not has_room(folder)


def has_room(folder: Path, size: int = LEAST_ROOM) -> bool:
    """Whether a folder could hold `size` bytes more; tried, not asked, so that quotas count."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        if is_disk_full(error):
            return False
        raise
    return True
