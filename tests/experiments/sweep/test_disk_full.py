"""A full disk stops a sweep cleanly: one line, nothing half-written, and it goes on afterwards."""

from __future__ import annotations

import errno
import os
import resource
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from experiments.errors import MachineryError
from experiments.sweep import disk
from experiments.sweep.disk import DiskFullError, has_room, is_disk_full
from experiments.sweep.folder import SweepFolder
from experiments.sweep.ledger import SweepLedger
from tests.experiments.sweep.test_kill import REPOSITORY
from tests.experiments.sweep.tiny_jobs import (
    assert_each_done_once,
    python_work,
    sweep_here,
    tiny_work,
)


def ledger_is_sound(path: Path) -> bool:
    base = sqlite3.connect(path)
    try:
        return bool(base.execute("PRAGMA integrity_check").fetchone()[0] == "ok")
    finally:
        base.close()


def test_errors_of_a_full_disk_are_known() -> None:
    assert is_disk_full(OSError(errno.ENOSPC, "x"))
    assert is_disk_full(OSError(errno.EDQUOT, "x"))
    assert not is_disk_full(OSError(errno.EACCES, "x"))
    assert not is_disk_full(ValueError("no space left"))
    wrapped = MachineryError("a", "b", "c")
    wrapped.__cause__ = OSError(errno.ENOSPC, "x")
    assert is_disk_full(wrapped)


def test_a_ledger_that_is_full_rolls_back(tmp_path: Path) -> None:
    # SQLite's own limit raises the error of a full disk: SQLITE_FULL
    ledger = SweepLedger(tmp_path / "ledger.sqlite", "me")
    ledger.want({"a" * 64: ("first", {})})
    pages = ledger._base.execute("PRAGMA page_count").fetchone()[0]
    ledger._base.execute(f"PRAGMA max_page_count = {pages}")
    many = {f"{n:064x}": (f"job {n}", {"text": "x" * 100}) for n in range(1000)}
    with pytest.raises(sqlite3.OperationalError) as caught:
        ledger.want(many)
    assert is_disk_full(caught.value)
    assert ledger.counts()["waiting"] == 1
    ledger.close()
    assert ledger_is_sound(tmp_path / "ledger.sqlite")


def test_a_full_disk_is_no_fault_of_the_job(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    full = f"raise SystemExit({disk.EXIT_DISK_FULL})"
    with pytest.raises(DiskFullError, match=r"the disk is full.*make room"):
        sweep_here(folder, python_work(full), retries=0)
    ledger = SweepLedger(SweepFolder(folder).ledger, "me")
    ledger.want({"ab" * 32: ("odd", {})})
    assert ledger.counts()["waiting"] == 1
    ledger.close()


def test_a_disk_that_fills_while_publishing_stops_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "sweep"
    work = tiny_work(folder, 4)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "link", full)
        with pytest.raises(DiskFullError):
            sweep_here(folder, work)
    assert not list(SweepFolder(folder).records.glob("*.json"))
    assert ledger_is_sound(SweepFolder(folder).ledger)
    sweep_here(folder, work)
    assert_each_done_once(folder, work)


LIMITED = """
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)), resource.RLIM_INFINITY))
sys.argv[0] = "tiny_jobs"
runpy.run_module("tests.experiments.sweep.tiny_jobs", run_name="__main__", alter_sys=False)
"""


@pytest.mark.parametrize("kib", [2, 8, 40, 90])
def test_no_file_larger_than_a_limit_at_any_step(tmp_path: Path, kib: int) -> None:
    # The limit stands for a full disk: it also hits SQLite, its log, and the jobs' own files
    folder, count = tmp_path / "sweep", 20
    folder.mkdir()
    work = tiny_work(folder, count)
    limited = subprocess.run(
        [sys.executable, "-c", LIMITED, str(1024 * kib), str(folder), str(count)],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert limited.returncode == 3, limited.stderr
    assert len(limited.stderr.splitlines()) == 1, limited.stderr
    assert "the disk is full" in limited.stderr
    if SweepFolder(folder).ledger.exists():
        assert ledger_is_sound(SweepFolder(folder).ledger)
    sweep_here(folder, work, workers=4)
    assert_each_done_once(folder, work)


def test_room_is_tried(tmp_path: Path) -> None:
    assert has_room(tmp_path, 4096)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, hard))
    try:
        assert not has_room(tmp_path, 2 << 20)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Yield a file system of 600 KiB, where the machine lets us mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=600k", "none", str(place)]
    try:
        mounted = subprocess.run(words, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no command mount")
    if mounted.returncode != 0:
        pytest.skip(f"no tmpfs can be mounted: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_file_system_that_fills_stops_the_sweep_and_goes_on_when_grown(
    small_disk: Path,
) -> None:
    folder, count = small_disk / "sweep", 40
    work = tiny_work(folder, count)
    stopped = subprocess.run(
        [sys.executable, "-m", "tests.experiments.sweep.tiny_jobs", str(folder), str(count)],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert stopped.returncode == 3, stopped.stderr
    assert [line for line in stopped.stderr.splitlines() if "the disk is full" in line]
    assert len(stopped.stderr.splitlines()) == 1, stopped.stderr
    assert ledger_is_sound(SweepFolder(folder).ledger)
    assert 0 < len(list(SweepFolder(folder).records.glob("*.json"))) < count
    words = ["mount", "-o", "remount,size=64m", str(small_disk)]
    subprocess.run(words, check=True)
    sweep_here(folder, work)
    assert_each_done_once(folder, work)
