"""The sweep itself: claim a job, run an attempt, settle the row, until no job is open."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from experiments.sweep.attempt import Outcome, Ticket
from experiments.sweep.disk import DiskFullError, blames_disk
from experiments.sweep.folder import SweepFolder
from experiments.sweep.lanes import Lanes
from experiments.sweep.ledger import Claim, Failure, SweepLedger
from experiments.sweep.locks import held, is_held
from experiments.sweep.work import Work

LONGEST_BACK_OFF: Final = 300.0
"""Seconds."""

WAIT_SECONDS: Final = 0.2
"""How long the loop waits for an end before it looks for other work."""


@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """How the jobs are run, which says nothing about their results."""

    timeout: float = 3600.0
    """Of an attempt, seconds."""
    retries: int = 2
    """Attempts after the first that failed."""
    back_off: float = 2.0
    """Seconds before the first of them; doubled for each further one."""
    is_retrying: bool = False
    """Whether jobs that were set aside before are tried again."""


@dataclass(frozen=True, kw_only=True)
class SweepEnd:
    """How a sweep ended."""

    total: int
    done: int
    found: int
    """Of those, done before it began."""
    set_aside: list[Failure]


@dataclass(frozen=True, kw_only=True)
class Settled:
    """Something that is told of a job."""

    claim: Claim
    outcome: Outcome
    state: str
    done: int
    """Jobs that are done or set aside."""
    total: int


def run_sweep(
    folder: SweepFolder,
    work: Mapping[str, Work],
    lanes: Lanes,
    options: SweepOptions,
    tell: Callable[[Settled], None] = lambda _: None,
) -> SweepEnd:
    """Run all jobs that are not finished yet.

    Parameters
    ----------
    folder
        The sweep's folder; what is finished in it is not run again.
    work
        The jobs by key.
    lanes
        Where attempts run.
    options
        Limits.
    tell
        Called whenever an attempt has ended.

    Raises
    ------
    DiskFullError
        The ledger is whole, and no record is half-written.
    """
    try:
        with _owner(folder) as owner:
            ledger = SweepLedger(folder.ledger, owner, socket.gethostname(), os.getpid())
            with contextlib.closing(ledger):
                sweep = _Sweep(folder, work, lanes, options, tell, ledger)
                return sweep.run()
    except Exception as error:
        if isinstance(error, DiskFullError) or not blames_disk(error, folder.root):
            raise
        raise DiskFullError(folder.root) from error


@contextlib.contextmanager
def _owner(folder: SweepFolder) -> Iterator[str]:
    """Give this sweep a name that others can see living."""
    owner = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
    path = folder.owner_lock(owner)
    with held(path):
        try:
            yield owner
        finally:
            path.unlink(missing_ok=True)


class _Sweep:
    """One run of the loop."""

    def __init__(
        self,
        folder: SweepFolder,
        work: Mapping[str, Work],
        lanes: Lanes,
        options: SweepOptions,
        tell: Callable[[Settled], None],
        ledger: SweepLedger,
    ) -> None:
        self._folder, self._work, self._lanes = folder, work, lanes
        self._options, self._tell, self._ledger = options, tell, ledger
        self._claims: dict[str, Claim] = {}

    def run(self) -> SweepEnd:
        """Run until no job is open, and leave no row of ours running."""
        self._ledger.want({key: (each.label, each.parameters) for key, each in self._work.items()})
        self._reopen()
        found = self._ledger.counts()["done"]
        try:
            self._loop()
        except BaseException:
            self._stop()
            raise
        counts = self._ledger.counts()
        return SweepEnd(
            total=len(self._work),
            done=counts["done"],
            found=found,
            set_aside=self._ledger.set_aside(),
        )

    def _reopen(self) -> None:
        """Open jobs whose record somebody removed, and those set aside if that is asked for."""
        for key, record in self._ledger.done().items():
            if not (self._folder.root / record).is_file():
                self._folder.clear_attempts(key)
                self._ledger.reopen(key)
        if self._options.is_retrying:
            for failure in self._ledger.set_aside():
                self._ledger.reopen(failure.key)

    def _loop(self) -> None:
        while True:
            self._ledger.release(self._is_alive)
            while self._lanes.has_room:
                claim = self._ledger.claim(time.time())
                if claim is None:
                    break
                self._start(claim)
            counts = self._ledger.counts()
            if not counts["waiting"] and not counts["running"]:
                return
            for ended in self._lanes.wait(WAIT_SECONDS):
                self._settle(*ended)

    def _is_alive(self, owner: str) -> bool:
        """Whether a sweep that has taken jobs lives; the lock file of a dead one is removed."""
        lock = self._folder.owner_lock(owner)
        if is_held(lock):
            return True
        lock.unlink(missing_ok=True)
        return False

    def _start(self, claim: Claim) -> None:
        self._claims[claim.key] = claim
        work = self._work[claim.key]
        job_file = self._folder.job_file(claim.key)
        job_file.parent.mkdir(parents=True, exist_ok=True)
        work.write(job_file)
        self._lanes.start(
            Ticket(
                root=self._folder.root,
                key=claim.key,
                label=claim.label,
                attempt=claim.attempt,
                command=work.command,
                timeout=self._options.timeout,
            )
        )

    def _settle(self, ticket: Ticket, outcome: Outcome) -> None:
        """Bring a row up to date with how its attempt ended."""
        if outcome.kind == "disk full":
            raise DiskFullError(self._folder.root)
        if outcome.kind == "finished":
            outcome = self._publish(ticket, outcome)
        key, now = ticket.key, time.time()
        state = "done"
        if outcome.kind in ("busy", "stopped"):
            is_started = outcome.kind == "stopped"
            self._ledger.give_back(key, now + 2.0 * WAIT_SECONDS, is_started=is_started)
            state = "waiting"
        elif outcome.kind != "finished":
            most = 1 if outcome.kind == "refused" else self._options.retries + 1
            pause = self._options.back_off * 2.0 ** min(self._claims[key].failures, 16)
            state = self._ledger.fail(key, outcome.line, now + min(pause, LONGEST_BACK_OFF), most)
        claim = self._claims.pop(key)
        if outcome.kind != "busy":
            counts = self._ledger.counts()
            done = counts["done"] + counts["set aside"]
            self._tell(
                Settled(claim=claim, outcome=outcome, state=state, done=done, total=len(self._work))
            )

    def _publish(self, ticket: Ticket, outcome: Outcome) -> Outcome:
        """Move the record among the others and close the row; a broken record is a failure."""
        receipt = self._folder.finished(ticket.key)
        try:
            if receipt is None:
                raise ValueError(f"no record in {self._folder.job(ticket.key)}")
            record = self._folder.publish(receipt)
        except ValueError as error:
            self._folder.clear_attempts(ticket.key)
            return Outcome(kind="failed", line=" ".join(str(error).split()))
        self._ledger.finish(
            ticket.key, str(record.relative_to(self._folder.root)), outcome.seconds or None
        )
        return outcome

    def _stop(self) -> None:
        """End what runs, and hand back its rows where the ledger still takes a change."""
        for ticket, outcome in self._lanes.stop():
            with contextlib.suppress(Exception):
                self._put_away(ticket, outcome)
        for key in list(self._claims):
            # A row that stays is released by the next sweep, which sees that this one is gone.
            with contextlib.suppress(Exception):
                self._ledger.give_back(key, 0.0)

    def _put_away(self, ticket: Ticket, outcome: Outcome) -> None:
        if outcome.kind == "finished":
            self._publish(ticket, outcome)
            self._claims.pop(ticket.key, None)
        elif outcome.kind != "busy":
            shutil.rmtree(self._folder.attempt(ticket.key, ticket.attempt), ignore_errors=True)
