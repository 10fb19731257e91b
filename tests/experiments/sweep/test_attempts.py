"""Time limits, retries, jobs that are set aside, and processes that leave children behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments.errors import EXIT_BAD_INPUT
from experiments.sweep.attempt import Outcome, Ticket, run_attempt
from experiments.sweep.folder import SweepFolder
from experiments.sweep.lanes import LocalLanes
from experiments.sweep.locks import held, is_held
from experiments.sweep.run import Settled, SweepOptions, run_sweep
from experiments.sweep.work import Work
from tests.experiments.sweep.tiny_jobs import python_work, sweep_here, tiny_work

KEY = "ab" * 32


def attempt(folder: Path, code: str, timeout: float = 10.0) -> Outcome:
    folder.mkdir(exist_ok=True)
    SweepFolder(folder).job(KEY).mkdir(parents=True, exist_ok=True)
    return run_attempt(
        Ticket(
            root=folder,
            key=KEY,
            label="odd",
            attempt=1,
            command=("{python}", "-I", "-S", "-c", code, "{output}"),
            timeout=timeout,
        )
    )


@pytest.mark.parametrize(
    ("code", "kind", "line"),
    [
        ("raise SystemExit('vctgi: it broke')", "failed", "it broke"),
        ("print('so far'); raise SystemExit(2)", "refused", "so far"),
        ("", "failed", "ended with 0 and without a record or a word"),
        ("import os; os.kill(os.getpid(), 11)", "failed", "killed by SIGSEGV"),
        ("raise SystemExit(74)", "disk full", ""),
    ],
)
def test_how_an_attempt_ended_is_told(tmp_path: Path, code: str, kind: str, line: str) -> None:
    outcome = attempt(tmp_path / "sweep", code)
    assert (outcome.kind, outcome.line) == (kind, line)
    assert not SweepFolder(tmp_path / "sweep").attempt(KEY, 1).exists()


def test_a_late_attempt_is_asked_and_then_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("experiments.sweep.attempt.GRACE_SECONDS", 0.2)
    deaf = (
        "import signal, time; signal.signal(signal.SIGTERM, lambda *_: print('asked', flush=True))"
        "; print('deaf', flush=True)\nwhile True: time.sleep(0.01)"
    )
    began = time.monotonic()
    outcome = attempt(tmp_path / "sweep", deaf, timeout=0.5)
    assert outcome.kind == "failed"
    assert outcome.line == "took longer than 0.5 s; last said: asked"
    assert time.monotonic() - began < 5.0


def test_an_attempt_takes_its_children_with_it(tmp_path: Path) -> None:
    code = (
        "import subprocess, sys; child = subprocess.Popen([sys.executable, '-c', "
        "'import time; time.sleep(60)']); raise SystemExit(str(child.pid))"
    )
    pid = int(attempt(tmp_path / "sweep", code).line)
    for _ in range(200):
        state = Path(f"/proc/{pid}/stat")
        if not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z":
            return
        time.sleep(0.01)
    os.kill(pid, signal.SIGKILL)
    pytest.fail("a child lived on")


def test_a_poison_job_is_set_aside_after_its_retries(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    poison = python_work("import os; os.kill(os.getpid(), 9)", "poison")
    work = {**poison, **tiny_work(folder, 3)}
    end = sweep_here(folder, work, retries=2)
    assert end.done == 3
    [failure] = end.set_aside
    assert (failure.label, failure.attempt, failure.error) == ("poison", 3, "killed by SIGKILL")
    again = sweep_here(folder, work, retries=2)
    assert [each.attempt for each in again.set_aside] == [3], "it stays aside"
    last = sweep_here(folder, work, retries=0, is_retrying=True)
    assert [each.attempt for each in last.set_aside] == [4], "unless it is asked for"


def test_what_is_refused_is_not_tried_again(tmp_path: Path) -> None:
    work = python_work(f"raise SystemExit({EXIT_BAD_INPUT})")
    [failure] = sweep_here(tmp_path / "sweep", work, retries=5).set_aside
    assert failure.attempt == 1


def test_retries_back_off(tmp_path: Path) -> None:
    times: list[float] = []

    def tell(_: Settled) -> None:
        times.append(time.monotonic())

    options = SweepOptions(timeout=10.0, retries=2, back_off=0.5)
    work = python_work("raise SystemExit(1)")
    run_sweep(SweepFolder(tmp_path), work, LocalLanes(1), options, tell)
    assert times[1] - times[0] > 0.5
    assert times[2] - times[1] > 1.0


def test_a_job_that_another_process_works_on_is_left_alone(tmp_path: Path) -> None:
    folder = SweepFolder(tmp_path)
    with held(folder.job_lock(KEY)) as lock:
        assert lock is not None
        assert attempt(tmp_path, "print('never')").kind == "busy"
        holder = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", "import time; time.sleep(60)"], pass_fds=(lock,)
        )
    assert is_held(folder.job_lock(KEY)), "a child holds the lock on after its parent"
    holder.kill()
    holder.wait()
    assert not is_held(folder.job_lock(KEY))


def test_lanes_are_dealt_to_devices(tmp_path: Path) -> None:
    code = (
        "import os, sys, pathlib; path = pathlib.Path(sys.argv[1]).parents[2] / 'seen';"
        "path.open('a').write(os.environ['CUDA_VISIBLE_DEVICES'] + ' ');"
        "import time; time.sleep(0.3)"
    )
    [work] = python_work(code).values()
    jobs = {f"{n}" * 64: Work(label=f"{n}", command=work.command) for n in range(4)}
    options = SweepOptions(timeout=10.0, retries=0)
    run_sweep(SweepFolder(tmp_path), jobs, LocalLanes(4, ["0", "3"]), options)
    assert sorted((tmp_path / "seen").read_text().split()) == ["0", "0", "3", "3"]


def test_ctrl_c_ends_attempts_and_hands_their_rows_back(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    folder.mkdir()
    work = python_work("import time; time.sleep(60)")

    class Interrupted(LocalLanes):
        def wait(self, seconds: float) -> list[tuple[Ticket, Outcome]]:
            if not self._stopping.is_set():
                raise KeyboardInterrupt
            return super().wait(seconds)

    with pytest.raises(KeyboardInterrupt):
        run_sweep(SweepFolder(folder), work, Interrupted(1), SweepOptions())
    assert not is_held(SweepFolder(folder).job_lock(KEY))
    assert not list((folder / "sweeps").iterdir())
    finished = {KEY: next(iter(tiny_work(folder, 1).values()))}
    assert sweep_here(folder, finished).done == 1
