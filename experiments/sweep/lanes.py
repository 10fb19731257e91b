"""Where attempts run: side by side on this machine, or elsewhere."""

from __future__ import annotations

import dataclasses
import queue
import threading
from collections.abc import Sequence
from typing import Protocol

from experiments.sweep.attempt import Outcome, Ticket, run_attempt

Ended = tuple[Ticket, Outcome]


class Lanes(Protocol):
    """Runs attempts without waiting for them."""

    @property
    def has_room(self) -> bool:
        """Whether another attempt could start now."""

    @property
    def running_count(self) -> int:
        """Attempts that have not ended, or whose end was not told."""

    def start(self, ticket: Ticket) -> None:
        """Start an attempt; only where there is room."""

    def wait(self, seconds: float) -> list[Ended]:
        """Return the attempts that have ended, waiting at most so long for the first."""

    def stop(self) -> list[Ended]:
        """End all attempts that can be ended; return the outcome of all."""


class LocalLanes:
    """Attempts on this machine, each watched by a thread.

    Parameters
    ----------
    count
        Attempts at a time.
    gpus
        Devices that lanes are dealt out to in turn, as CUDA_VISIBLE_DEVICES names them; none: every
        attempt sees all devices.
    """

    def __init__(self, count: int, gpus: Sequence[str] = ()) -> None:
        self._free = [gpus[number % len(gpus)] if gpus else "" for number in range(count)][::-1]
        self._running: dict[str, tuple[threading.Thread, str]] = {}
        self._ended: queue.Queue[tuple[Ticket, Outcome | BaseException]] = queue.Queue()
        self._stopping = threading.Event()

    @property
    def has_room(self) -> bool:
        """Whether a lane is free."""
        return bool(self._free)

    @property
    def running_count(self) -> int:
        """Lanes that are taken."""
        return len(self._running)

    def start(self, ticket: Ticket) -> None:
        """Start an attempt in a free lane."""
        gpu = self._free.pop()
        if gpu:
            environment = {**ticket.environment, "CUDA_VISIBLE_DEVICES": gpu}
            ticket = dataclasses.replace(ticket, environment=environment)
        thread = threading.Thread(target=self._watch, args=(ticket,), daemon=True)
        self._running[ticket.key] = (thread, gpu)
        thread.start()

    def _watch(self, ticket: Ticket) -> None:
        try:
            self._ended.put((ticket, run_attempt(ticket, self._stopping.is_set)))
        except BaseException as error:  # handed to the thread that can report it
            self._ended.put((ticket, error))

    def wait(self, seconds: float) -> list[Ended]:
        """Return the attempts that have ended."""
        found = []
        try:
            found.append(self._ended.get(timeout=seconds))
            while True:
                found.append(self._ended.get_nowait())
        except queue.Empty:
            pass
        for ticket, _ in found:
            thread, gpu = self._running.pop(ticket.key)
            thread.join()
            self._free.append(gpu)
        failures = [ended for _, ended in found if isinstance(ended, BaseException)]
        if failures:
            raise failures[0]
        return [(ticket, ended) for ticket, ended in found if isinstance(ended, Outcome)]

    def stop(self) -> list[Ended]:
        """End all attempts: first asked, then killed."""
        self._stopping.set()
        for thread, _ in self._running.values():
            thread.join()
        self._running.clear()
        ended = []
        while not self._ended.empty():
            ended.append(self._ended.get())
        return [(ticket, outcome) for ticket, outcome in ended if isinstance(outcome, Outcome)]
