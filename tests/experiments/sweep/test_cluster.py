"""A sweep on a real Dask scheduler with several worker processes, one of which is killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from experiments.errors import InputError, MachineryError
from experiments.sweep.cluster import ClusterLanes
from experiments.sweep.folder import SweepFolder
from experiments.sweep.run import Settled, SweepOptions, run_sweep
from tests.experiments.sweep.test_kill import REPOSITORY
from tests.experiments.sweep.tiny_jobs import assert_each_done_once, python_work, tiny_work

pytest.importorskip("distributed", reason="the extra [cluster] is not installed")

pytestmark = pytest.mark.slow

START_SECONDS = 40.0
"""Importing Dask takes seconds on a busy machine."""

OPTIONS = SweepOptions(timeout=20.0, retries=2, back_off=0.01)


@dataclass
class Cluster:
    """A scheduler and its workers, each a process."""

    address: str
    folder: Path

    def start_worker(self, *words: str) -> subprocess.Popen[bytes]:
        return dask("worker", self.address, "--no-nanny", "--nthreads", "1", *words, at=self.folder)


def dask(*words: str, at: Path) -> subprocess.Popen[bytes]:
    with (at / "dask.log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--no-dashboard"],
            cwd=at,
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
            stdout=log,
            stderr=subprocess.STDOUT,
        )


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    words = ("--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    scheduler = dask("scheduler", *words, at=folder)
    found = Cluster(address="", folder=folder)
    workers: list[subprocess.Popen[bytes]] = []
    try:
        deadline = time.monotonic() + START_SECONDS
        while not found.address:
            assert scheduler.poll() is None, (folder / "dask.log").read_text()
            assert time.monotonic() < deadline, (folder / "dask.log").read_text()
            time.sleep(0.05)
            if file.exists() and file.read_text().strip():
                found.address = json.loads(file.read_text())["address"]
        workers += [
            found.start_worker(),
            found.start_worker("--resources", "GPU=1"),
        ]
        yield found
    finally:
        # They hold nothing that a kill could harm, and on a busy machine farewells take long.
        for process in [*workers, scheduler]:
            process.kill()
            process.wait()


def lanes_with(cluster: Cluster, slots: int, **options: bool) -> ClusterLanes:
    """Connect once the workers are there."""
    lanes = ClusterLanes(cluster.address, **options)
    deadline = time.monotonic() + START_SECONDS
    while lanes._slots() < slots:
        assert time.monotonic() < deadline, (cluster.folder / "dask.log").read_text()
        time.sleep(0.05)
    return lanes


def test_a_worker_that_is_killed_costs_nothing(cluster: Cluster, tmp_path: Path) -> None:
    victim = cluster.start_worker()
    folder = tmp_path / "sweep"
    folder.mkdir()
    work = tiny_work(folder, 30, seconds=0.1)
    lanes = lanes_with(cluster, 3)

    def tell(settled: Settled) -> None:
        if settled.done == 5:
            victim.kill()

    end = run_sweep(SweepFolder(folder), work, lanes, OPTIONS, tell)
    lanes.close()
    victim.wait()
    assert (end.done, end.set_aside) == (30, [])
    assert_each_done_once(folder, work)


def test_a_poison_job_takes_no_worker_with_it(cluster: Cluster, tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    folder.mkdir()
    poison = python_work("import os; os.kill(os.getpid(), 9)", "poison")
    work = {**poison, **tiny_work(folder, 6)}
    lanes = lanes_with(cluster, 2)
    end = run_sweep(SweepFolder(folder), work, lanes, OPTIONS)
    assert lanes._slots() == 2
    lanes.close()
    assert end.done == 6
    assert [each.error for each in end.set_aside] == ["killed by SIGKILL"]


def test_jobs_for_a_device_go_to_workers_that_have_one(cluster: Cluster, tmp_path: Path) -> None:
    lanes_with(cluster, 2).close()
    lanes = ClusterLanes(cluster.address, needs_gpu=True)
    assert lanes._slots() == 1
    folder = tmp_path / "sweep"
    folder.mkdir()
    work = tiny_work(folder, 3)
    assert run_sweep(SweepFolder(folder), work, lanes, OPTIONS).done == 3
    lanes.close()
    assert_each_done_once(folder, work)


def test_no_scheduler_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("experiments.sweep.cluster.CONNECT_SECONDS", 0.5)
    with pytest.raises(MachineryError, match=r"no Dask scheduler answers.*127.0.0.1:1;"):
        ClusterLanes("tcp://127.0.0.1:1")


def test_no_device_is_one_line(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("experiments.sweep.cluster.GPU", "TPU")
    with pytest.raises(InputError, match=r"no worker of the cluster has a GPU"):
        ClusterLanes(cluster.address, needs_gpu=True)
