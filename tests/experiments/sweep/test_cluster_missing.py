"""Without the extra, `--cluster` says what to install."""

from __future__ import annotations

import sys

import pytest

from experiments.errors import MachineryError
from experiments.sweep.cluster import ClusterLanes


def test_a_missing_extra_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MachineryError, match=r"Dask is not installed.*vctgi\[cluster\]"):
        ClusterLanes("tcp://127.0.0.1:8786")
