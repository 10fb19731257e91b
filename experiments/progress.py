"""Progress of long work on standard error: a bar on a terminal, a line per step elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

QUIET_SECONDS = 20.0
"""Without a terminal, a step that takes longer says so this often."""


class ProgressReport:
    """Shows which scene is at which step, and how far it is."""

    def __init__(self) -> None:
        self._console = Console(file=sys.stderr, emoji=False)
        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
        )
        self._task = self._bar.add_task("", total=1.0)
        self._scene = ""
        self._step = ""
        self._spoke_at = 0.0
        self._began = (0.0, 0.0)

    def __enter__(self) -> ProgressReport:
        if self._console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        if self._console.is_terminal:
            self._bar.stop()

    def start_scene(self, title: str, number: int, count: int) -> None:
        """Begin a scene, number 1 .. count."""
        self._scene = f"[{number}/{count}] {title}"
        self._step = ""

    def __call__(self, step: str, share: float) -> None:
        """Say that a step is done to a share in [0, 1]."""
        is_new = step != self._step
        if is_new:
            self._step = step
            self._bar.reset(self._task, description=f"{self._scene}: {step}")
        self._bar.update(self._task, completed=share)
        now = time.monotonic()
        if is_new:
            self._began = (now, share)
        if not self._console.is_terminal and (is_new or now - self._spoke_at > QUIET_SECONDS):
            self._spoke_at = now
            percent = "" if is_new else f" {100.0 * share:.0f} %{self._time_left(now, share)}"
            self._console.print(f"{self._scene}: {step}{percent}", highlight=False, markup=False)

    def _time_left(self, now: float, share: float) -> str:
        """Say how long the rest of the step takes at the pace since its first report."""
        began, first_share = self._began
        gained = share - first_share
        if gained <= 0.0 or share >= 1.0:
            return ""
        return f", about {time_text((now - began) * (1.0 - share) / gained)} left"

    def say(self, line: str) -> None:
        """Print a line that stays."""
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)


def time_text(seconds: float) -> str:
    """Write a duration as people say it: `40 s`, `3 min`, `2 h 05 min`."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
