"""One attempt at a job: a process of its own, with a time limit, whatever it does."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

from experiments.errors import EXIT_BAD_INPUT
from experiments.sweep.disk import EXIT_DISK_FULL, has_room, is_disk_full
from experiments.sweep.folder import SweepFolder
from experiments.sweep.locks import held
from experiments.sweep.same_code import same_code_environment

OutcomeKind = Literal["finished", "failed", "refused", "busy", "disk full", "stopped"]

GRACE_SECONDS: Final = 5.0
"""Between asking a process to end and ending it."""

POLL_SECONDS: Final = 0.02
"""How often a process is looked at: small beside any render."""

LOG_TAIL: Final = 8192
"""Bytes of a log in which its last line is sought."""


@dataclass(frozen=True, kw_only=True)
class Ticket:
    """What has to be run; it crosses to other machines."""

    root: Path
    """The sweep's folder."""
    key: str
    label: str
    attempt: int
    command: tuple[str, ...]
    """Words, in which {python}, {job} and {output} are this machine's Python, the job's file and
    the attempt's folder. It has done its work when it leaves `{output}/records/ID.json`."""
    timeout: float
    """Seconds."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Variables that the process has besides ours."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How it ended.

    `finished`: there is a record. `failed`: there is none. `refused`: bad input, which another
    attempt would not mend. `busy`: another process works on the job. `stopped`: we ended it, not by
    its fault.
    """

    kind: OutcomeKind
    line: str = ""
    """What went wrong."""
    seconds: float = 0.0


def run_attempt(ticket: Ticket, is_stopping: Callable[[], bool] = lambda: False) -> Outcome:
    """Run a job in a process of its own, unless it is finished or another process runs it.

    The process holds the job's lock: should we be killed, nobody else starts the job while it
    goes on, and its record is found when it is finished.

    Parameters
    ----------
    ticket
        The job.
    is_stopping
        Asked again and again; True ends the process.
    """
    folder = SweepFolder(ticket.root)
    try:
        with held(folder.job_lock(ticket.key)) as lock:
            if lock is None:
                return Outcome(kind="busy")
            if folder.finished(ticket.key) is not None:
                return Outcome(kind="finished")
            folder.clear_attempts(ticket.key)
            return _run(ticket, folder, lock, is_stopping)
    except OSError as error:
        if is_disk_full(error):
            return Outcome(kind="disk full")
        return Outcome(kind="failed", line=f"{socket.gethostname()}: {error}")


def _run(
    ticket: Ticket, folder: SweepFolder, lock: int, is_stopping: Callable[[], bool]
) -> Outcome:
    output = folder.attempt(ticket.key, ticket.attempt)
    output.mkdir()
    log = folder.log(ticket.key, ticket.attempt)
    places = {
        "{python}": sys.executable,
        "{job}": str(folder.job_file(ticket.key)),
        "{output}": str(output),
    }
    began = time.monotonic()
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [places.get(word, word) for word in ticket.command],
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            env={**same_code_environment(), **ticket.environment},
            start_new_session=True,
            pass_fds=(lock,),
        )
        cut = _await_end(process, began + ticket.timeout, is_stopping)
    seconds = time.monotonic() - began
    if folder.finished(ticket.key) is not None:
        return Outcome(kind="finished", seconds=seconds)
    shutil.rmtree(output, ignore_errors=True)
    if cut == "stopped":
        return Outcome(kind="stopped", seconds=seconds)
    if process.returncode == EXIT_DISK_FULL or not has_room(ticket.root):
        return Outcome(kind="disk full", seconds=seconds)
    kind: OutcomeKind = "refused" if process.returncode == EXIT_BAD_INPUT else "failed"
    line = last_line(log)
    if cut == "late":
        line = f"took longer than {ticket.timeout:g} s" + (f"; last said: {line}" if line else "")
    elif process.returncode < 0:
        name = signal.Signals(-process.returncode).name
        line = f"killed by {name}" + (f"; last said: {line}" if line else "")
    elif not line:
        line = f"ended with {process.returncode} and without a record or a word"
    return Outcome(kind=kind, line=line, seconds=seconds)


def _await_end(
    process: subprocess.Popen[bytes], deadline: float, is_stopping: Callable[[], bool]
) -> Literal["", "late", "stopped"]:
    """Wait for the end, and bring it about where it has to be; leave no child of it behind."""
    cut: Literal["", "late", "stopped"] = ""
    while not _has_ended(process.pid):
        if is_stopping():
            cut = "stopped"
        elif time.monotonic() > deadline:
            cut = "late"
        if cut:
            os.killpg(process.pid, signal.SIGTERM)
            grace = time.monotonic() + GRACE_SECONDS
            while not _has_ended(process.pid) and time.monotonic() < grace:
                time.sleep(POLL_SECONDS)
            break
        time.sleep(POLL_SECONDS)
    # Not waited for yet, the process keeps its number, so this hits nobody else.
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return cut


def _has_ended(pid: int) -> bool:
    """Whether a child has ended; it stays a zombie."""
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def last_line(log: Path) -> str:
    """Return the last line of a log that says something, without the name of the command."""
    with log.open("rb") as stream:
        stream.seek(max(0, log.stat().st_size - LOG_TAIL))
        text = stream.read().decode("utf-8", errors="replace")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1].removeprefix("vctgi: ") if lines else ""
