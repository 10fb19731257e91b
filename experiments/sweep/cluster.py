"""Attempts on an existing Dask cluster: Dask carries the ticket, the worker starts the process.

Dask neither resumes nor isolates: a job that kills its worker takes innocent ones with it. So each
task is only `run_attempt`, which may be run twice without harm, and the ledger stays here.
"""

from __future__ import annotations

import importlib
import queue
from typing import Any, Final

from experiments.errors import InputError, MachineryError
from experiments.sweep.attempt import Outcome, Ticket, run_attempt
from experiments.sweep.lanes import Ended

CONNECT_SECONDS: Final = 15.0
"""A scheduler on the same network answers in well under a second."""

GPU: Final = "GPU"
"""Resource of workers that have a device: `dask worker --resources GPU=1`."""


class ClusterLanes:
    """Attempts on the workers of a scheduler.

    Parameters
    ----------
    address
        Of the scheduler, such as `tcp://10.0.0.1:8786`.
    needs_gpu
        Whether an attempt takes one `GPU` of its worker's resources.
    count
        Most attempts at a time; None: as many as the workers have threads, or devices.

    Raises
    ------
    MachineryError
        The extra is not installed, or no scheduler answers.
    InputError
        A GPU is needed and no worker has one.
    """

    def __init__(self, address: str, *, needs_gpu: bool = False, count: int | None = None) -> None:
        distributed = _import_distributed()
        try:
            self._client = distributed.Client(
                address, timeout=CONNECT_SECONDS, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise MachineryError(
                what=f"no Dask scheduler answers ({' '.join(str(error).split())})",
                where=address,
                remedy="start one with `dask scheduler`, and its workers, or correct the address",
            ) from error
        self._address = address
        self._resources = {GPU: 1} if needs_gpu else None
        self._count = count
        self._running: dict[str, tuple[Ticket, Any]] = {}
        self._ended: queue.Queue[str] = queue.Queue()
        if needs_gpu and self._slots() == 0:
            self._client.close()
            raise InputError(
                what="no worker of the cluster has a GPU to give",
                where=address,
                remedy="start workers with `dask worker ... --resources GPU=1`, one a device",
            )

    def _slots(self) -> int:
        """Return how many attempts the workers can run at a time."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        if self._resources is None:
            return sum(int(worker["nthreads"]) for worker in workers)
        return sum(int(worker.get("resources", {}).get(GPU, 0)) for worker in workers)

    @property
    def has_room(self) -> bool:
        """Whether a worker could take another attempt."""
        return len(self._running) < (self._slots() if self._count is None else self._count)

    @property
    def running_count(self) -> int:
        """Tasks whose end was not told."""
        return len(self._running)

    def start(self, ticket: Ticket) -> None:
        """Hand a ticket to the scheduler."""
        future = self._client.submit(
            run_attempt,
            ticket,
            key=f"vctgi-{ticket.key[:16]}-{ticket.attempt}",
            resources=self._resources,
            pure=False,
        )
        self._running[ticket.key] = (ticket, future)
        future.add_done_callback(lambda _: self._ended.put(ticket.key))

    def wait(self, seconds: float) -> list[Ended]:
        """Return the attempts that have ended.

        Raises
        ------
        MachineryError
            The scheduler is gone.
        """
        keys = []
        try:
            keys.append(self._ended.get(timeout=seconds))
            while True:
                keys.append(self._ended.get_nowait())
        except queue.Empty:
            pass
        if self._client.status not in ("running", "connecting"):
            raise MachineryError(
                what="the Dask scheduler is gone",
                where=self._address,
                remedy="start it, and give the same command again: it goes on where it stopped",
            )
        return [self._end(*self._running.pop(key)) for key in keys if key in self._running]

    def _end(self, ticket: Ticket, future: Any) -> Ended:
        status = future.status
        if status == "finished":
            outcome: Outcome = future.result()
        elif status == "error":
            # Such as KilledWorker, when several workers died with the task
            error = future.exception()
            outcome = Outcome(kind="failed", line=f"Dask: {type(error).__name__}: {error}")
        else:
            outcome = Outcome(kind="stopped")
        return ticket, outcome

    def stop(self) -> list[Ended]:
        """Take back what no worker has begun.

        What has begun goes on to its end or its time limit; its record is found by the next sweep.
        """
        futures = [future for _, future in self._running.values()]
        if futures and self._client.status == "running":
            self._client.cancel(futures)
        found = [(ticket, Outcome(kind="busy")) for ticket, _ in self._running.values()]
        self._running.clear()
        self._client.close()
        return found

    def close(self) -> None:
        """Leave the cluster."""
        self._client.close()


def _import_distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise MachineryError(
            what=f"Dask is not installed ({error})",
            where="--cluster",
            remedy="pip install 'vctgi[cluster]'",
        ) from error
