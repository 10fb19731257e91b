"""Functions of arrays that someone may keep, so that the host need not trace them again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, Protocol, TypeVar

Found = TypeVar("Found")


class Recorder(Protocol):
    """What keeps functions of arrays, as `vctgi.trace_cache.TraceCache` does."""

    def run(self, key: Hashable, function: Callable[..., Found], *inputs: Any) -> Found:
        """Return what a function makes of its inputs, traced only when the key is new."""


def run_recorded(
    recorder: Recorder | None, key: Hashable, function: Callable[..., Found], *inputs: Any
) -> Found:
    """Return what a function makes of its inputs, by a recorder if there is one.

    Parameters
    ----------
    recorder
        Keeps what is traced; None: nobody does.
    key
        All that the function depends on besides its inputs.
    function
        Must make no arrays of host data and read none, and hold no width of its inputs in a kernel.
    inputs
        Its inputs, evaluated.
    """
    if recorder is None:
        return function(*inputs)
    return recorder.run(key, function, *inputs)
