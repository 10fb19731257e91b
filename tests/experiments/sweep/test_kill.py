"""Killed at any moment and started again, a sweep loses nothing and repeats nothing finished."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from experiments.sweep.folder import SweepFolder
from tests.experiments.sweep.tiny_jobs import (
    assert_each_done_once,
    diary,
    sweep_here,
    tiny_work,
)

REPOSITORY = Path(__file__).parents[3]

START_SECONDS = 20.0
"""A busy machine may take so long to import the sweep."""

LONGEST_LIFE = 0.25
"""Seconds from the ledger's change to the kill: some four tiny jobs, so every step is hit."""


def start_sweep(folder: Path, count: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "tests.experiments.sweep.tiny_jobs", str(folder), str(count)],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
    )


class Nursery:
    """A process that starts sweeps quickly, one after the other."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.experiments.sweep.tiny_jobs"],
            cwd=REPOSITORY,
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def start(self, folder: Path, count: int) -> int:
        """Return the number of the process, once it has taken its place in the folder."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{count} {folder}\n")
        self._process.stdin.flush()
        pid = self.answer()
        deadline = time.monotonic() + START_SECONDS
        while not list((folder / "sweeps").glob(f"*-{pid}-*.lock")):
            assert time.monotonic() < deadline
            time.sleep(0.002)
        return pid

    def answer(self) -> int:
        assert self._process.stdout is not None
        return int(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate()


@pytest.fixture
def nursery() -> Iterator[Nursery]:
    found = Nursery()
    yield found
    found.close()


def kill_attempts(folder: Path) -> None:
    """Kill the attempts that a killed sweep has left running."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if any(word.startswith(str(folder).encode() + b"/jobs/") for word in words):
            os.kill(int(process.name), signal.SIGKILL)


def kill_and_resume(nursery: Nursery, folder: Path, kills: int, seed: int) -> None:
    chance = random.Random(seed)
    work = tiny_work(folder, 4 * kills)
    for number in range(kills):
        pid = nursery.start(folder, len(work))
        time.sleep(chance.uniform(0.0, LONGEST_LIFE))
        os.kill(pid, signal.SIGKILL)  # fails, as it should, where all jobs were done before
        assert nursery.answer() == -signal.SIGKILL
        if number % 2:
            kill_attempts(folder)
    nursery.start(folder, len(work))
    assert nursery.answer() == 0
    assert_each_done_once(folder, work)


def test_five_kills_lose_nothing_and_repeat_nothing(nursery: Nursery, tmp_path: Path) -> None:
    kill_and_resume(nursery, tmp_path / "sweep", kills=5, seed=8)


@pytest.mark.slow
def test_fifty_kills_lose_nothing_and_repeat_nothing(nursery: Nursery, tmp_path: Path) -> None:
    kill_and_resume(nursery, tmp_path / "sweep", kills=50, seed=50)


def test_a_sweep_told_to_go_on_does_nothing_where_all_is_done(tmp_path: Path) -> None:
    folder, count = tmp_path / "sweep", 4
    sweep_here(folder, tiny_work(folder, count))
    end = sweep_here(folder, tiny_work(folder, count))
    assert (end.done, end.found) == (count, count)
    assert_each_done_once(folder, tiny_work(folder, count))


def test_two_sweeps_on_one_folder_share_the_jobs(tmp_path: Path) -> None:
    folder, count = tmp_path / "sweep", 30
    work = tiny_work(folder, count)
    both = [start_sweep(folder, count) for _ in range(2)]
    assert [process.wait(60) for process in both] == [0, 0]
    assert_each_done_once(folder, work)
    assert len(diary(folder).read_text().split()) == count


@pytest.mark.parametrize("step", ["finished", "pictures moved", "published", "no ledger"])
def test_a_record_without_its_row_is_taken_up(tmp_path: Path, step: str) -> None:
    folder = tmp_path / "sweep"
    work = tiny_work(folder, 1)
    sweep_here(folder, work)
    place = SweepFolder(folder)
    place.ledger.unlink()
    [record] = place.records.glob("*.json")
    [receipt] = place.root.glob("jobs/*/attempt-1/records/*.json")
    if step in ("finished", "pictures moved"):
        record.unlink()
    if step == "finished":
        (place.records / record.stem).rename(receipt.parent / record.stem)
    end = sweep_here(folder, work)
    assert end.done == 1
    assert_each_done_once(folder, work)
    assert len(diary(folder).read_text().split()) == 1


def test_a_record_that_somebody_removed_is_made_again(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    work = tiny_work(folder, 1)
    sweep_here(folder, work)
    [record] = SweepFolder(folder).records.glob("*.json")
    record.unlink()
    assert sweep_here(folder, work).done == 1
    assert len(diary(folder).read_text().split()) == 2
