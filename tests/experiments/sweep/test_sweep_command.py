"""The command `vctgi sweep` on a true scene: refusals, jobs in their own processes, going on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED, EXIT_MACHINERY
from reports.record import read_records

SMALL = ["--resolution", "16", "--spp", "8", "--preset", "medium", "--variant", "llvm_ad_rgb"]
CHEAP = ["--set", "samples_per_pixel=1", "--set", "clipmap.resolution=32"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "nothing to sweep"),
        (["nowhere.toml"], "cannot read the sweep file"),
        (["--scene", "no_such_scene"], "no built-in scene"),
        (["--scene", "corridor", "--preset", "best"], "no preset 'best'"),
        (["--scene", "corridor", "--set", "diffuse.cones=1"], "no field 'diffuse.cones'"),
        (["--scene", "corridor", "--seeds", "x"], "whole numbers"),
        (["--scene", "corridor", "--variant", "scalar_rgb"], "llvm_ad_rgb"),
        (["--scene", "corridor", "--workers", "0"], "at least 1"),
        (["--scene", "corridor", "--gpus", "0,"], "--gpus"),
        (["--scene", "corridor", "--timeout", "0"], "--timeout"),
        (["--scene", "corridor", "--cluster", "tcp://x:1", "--gpus", "0"], "do not go together"),
        (["--scene", "corridor", "--cluster", "tcp://x:1"], "no variant is named"),
    ],
)
def test_bad_usage_is_refused_and_leaves_nothing(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", *words]) == EXIT_BAD_INPUT
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_sweep_renders_records_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output, result = tmp_path / "sweep", tmp_path / "end.json"
    words = ["sweep", "--scene", "cornell_box", *SMALL, *CHEAP, "--output", str(output)]
    words += ["--cache", str(tmp_path / "cache"), "--json", str(result)]
    assert main(words) == EXIT_DONE
    assert "1 jobs: 1 done, 0 set aside" in capsys.readouterr().out
    [record] = read_records(output / "records").values()
    assert record.preset == "medium, samples_per_pixel=1, clipmap.resolution=32"
    assert record.config["samples_per_pixel"] == 1
    assert record.command.startswith("vctgi sweep --scene cornell_box --preset medium --set ")
    assert main(words) == EXIT_DONE
    assert "1 of them before" in capsys.readouterr().out
    assert json.loads(result.read_text()) == {"total": 1, "done": 1, "found": 1, "set_aside": []}
    assert main(["results", "page", str(output)]) == EXIT_DONE
    assert "clipmap.resolution=32" in (output / "index.html").read_text(encoding="utf-8")


def test_a_job_that_cannot_be_done_is_set_aside(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sweep", "--scene", "cornell_box", *SMALL, "--output", str(tmp_path / "sweep")]
    words += ["--cache", str(tmp_path / "cache"), "--timeout", "1", "--retries", "0"]
    assert main(words) == EXIT_FAILED
    assert "set aside after 1 attempts: cornell_box, medium, seed 0: took longer than 1 s" in (
        capsys.readouterr().out
    )


def test_a_dry_run_lists_the_jobs_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "--scene", "cornell_box", *SMALL, "--seeds", "0,1", "--dry-run"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(maxsplit=1)[1] for line in lines] == [
        "cornell_box, medium, seed 0",
        "cornell_box, medium, seed 1",
        "jobs",
    ]
    assert not list(tmp_path.iterdir())


def test_a_missing_cluster_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    monkeypatch.setattr("experiments.sweep.cluster.CONNECT_SECONDS", 0.5)
    words = ["sweep", "--scene", "cornell_box", *SMALL, "--output", str(tmp_path / "sweep")]
    assert main([*words, "--cluster", "tcp://127.0.0.1:1"]) == EXIT_MACHINERY
    assert "no Dask scheduler answers" in capsys.readouterr().err
