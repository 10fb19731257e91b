"""A ledger that another sweep is just making is waited for."""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from pathlib import Path

import pytest

from experiments.sweep import ledger
from experiments.sweep.ledger import SweepLedger


@pytest.fixture
def held(tmp_path: Path) -> sqlite3.Connection:
    """Return a connection that is writing, to a file that does not log ahead yet."""
    base = sqlite3.connect(tmp_path / "ledger", isolation_level=None, check_same_thread=False)
    base.execute("CREATE TABLE other (key TEXT)")
    base.execute("BEGIN IMMEDIATE")
    return base


def test_a_sweep_waits_for_another_that_begins(held: sqlite3.Connection, tmp_path: Path) -> None:
    release = threading.Timer(0.3, held.execute, ("COMMIT",))
    release.start()
    with contextlib.closing(SweepLedger(tmp_path / "ledger", "late")):
        release.join()
    held.close()


def test_it_does_not_wait_forever(
    held: sqlite3.Connection, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ledger, "BUSY_SECONDS", 0.1)
    with pytest.raises(sqlite3.OperationalError, match="locked"):
        SweepLedger(tmp_path / "ledger", "late")
    held.close()
