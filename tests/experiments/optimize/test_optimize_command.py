"""`vctgi optimize` on the Cornell box: a preset file, a kill, and refusals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_MACHINERY
from experiments.optimize import run
from experiments.optimize.frames import FrameSource
from experiments.optimize.run import FitOptions, fit_config
from experiments.optimize.views import ViewName, ViewOptions, make_view
from vctgi.config import preset
from vctgi.preset_file import read_preset_file

SMALL = [
    *("optimize", "cornell_box", "--preset", "medium", "--derivatives", "differences"),
    *("--resolution", "16", "--clipmap-resolution", "16", "--spp", "256", "--frames", "2"),
    *("--parameters", "exponent,start_offset", "--iterations", "3"),
]


def run_small(folder: Path, arguments: Sequence[str] = SMALL) -> int:
    """Fit into a folder: `fit.toml`, `fit.json`, and what is kept."""
    return main(
        [
            *arguments,
            *("--output", str(folder / "fit.toml")),
            *("--json", str(folder / "fit.json")),
            *("--cache", str(folder / "cache")),
        ]
    )


@pytest.fixture(scope="module")
def whole(variant: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a fit that nothing stopped."""
    folder = tmp_path_factory.mktemp("whole")
    assert run_small(folder) == EXIT_DONE
    return folder


def ledger_of(folder: Path) -> Path:
    (file,) = (folder / "cache" / "optimize").glob("*.jsonl")
    return file


def without_times(path: Path) -> str:
    """Return a preset file without what the clock and the folders say."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return "\n".join(each for each in lines if not each.startswith(("gathering_ms", "command")))


def test_a_fit_writes_a_preset_that_commands_take(whole: Path) -> None:
    path = whole / "fit.toml"
    file, record = read_preset_file(path), json.loads((whole / "fit.json").read_text())
    assert file.base == "medium"
    assert file.record == record
    assert record["objective_before"] == pytest.approx(1.0)
    assert record["objective_after"] <= 1.0
    assert record["held_out"] == ["cornell_box, turned"]
    fitted = preset(str(path))
    assert fitted.diffuse.march.correction_factor == record["parameters"]["exponent"]["end"]
    assert fitted.clipmap == preset("medium").clipmap
    assert main(["plan", "cornell_box", "--preset", str(path), "--resolution", "16"]) == EXIT_DONE


def test_a_fit_that_was_stopped_ends_where_it_would_have(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    picture, count = FrameSource.picture, 0

    def dies(self: FrameSource, *rest: object) -> object:
        nonlocal count
        count += 1
        if count > 9:
            raise RuntimeError("stopped")
        return picture(self, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(FrameSource, "picture", dies)
    assert run_small(tmp_path) == EXIT_MACHINERY
    assert not (tmp_path / "fit.toml").exists()
    kept = ledger_of(tmp_path).read_text().count("\n")
    assert 0 < kept < ledger_of(whole).read_text().count("\n")
    monkeypatch.setattr(FrameSource, "picture", picture)
    assert run_small(tmp_path) == EXIT_DONE
    assert without_times(tmp_path / "fit.toml") == without_times(whole / "fit.toml")
    # Nothing that was finished was done again.
    assert ledger_of(tmp_path).read_text() == ledger_of(whole).read_text()
    printed = capsys.readouterr().out
    assert "frames were found finished" in printed
    assert "cornell_box, turned  held out" in printed


@pytest.mark.slow
def test_a_killed_process_ends_where_it_would_have(tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    for folder in (whole, killed):
        command = [sys.executable, "-m", "experiments", *SMALL, "--variant", "llvm_ad_rgb"]
        command += ["--output", str(folder / "fit.toml"), "--cache", str(folder / "cache")]
        if folder == killed:
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            began = time.monotonic()
            while not list((folder / "cache").glob("optimize/*.jsonl")):
                assert time.monotonic() - began < 60.0
                assert process.poll() is None
                time.sleep(0.01)
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            assert not list(folder.glob("*.toml"))
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    assert without_times(killed / "fit.toml") == without_times(whole / "fit.toml")


def test_forward_derivatives_are_those_of_differences(variant: str, tmp_path: Path) -> None:
    options = FitOptions(
        scenes=("cornell_box",), preset="medium", parameters=("exponent",), clipmap_resolution=16
    )
    from experiments.optimize.run import check_options

    config, parameters = fit_config(options), check_options(options)
    size = ViewOptions(resolution=16, reference_spp=16, seed=0, cache=None)
    view = make_view(ViewName(scene="cornell_box"), size, config, lambda _step, _share: None)
    found = [
        FrameSource(0, kind).columns(view, 0, config, parameters)[0][0]
        for kind in ("forward", "differences")
    ]
    # The exponent moves no sample, so that nothing ripples.
    assert found[0] == pytest.approx(found[1], abs=0.01 * float(np.abs(found[1]).max()))


def test_frames_differ_in_their_place_and_repeat_exactly(variant: str) -> None:
    config = fit_config(FitOptions(scenes=("cornell_box",), preset="medium", clipmap_resolution=16))
    size = ViewOptions(resolution=16, reference_spp=16, seed=0, cache=None)
    view = make_view(ViewName(scene="cornell_box"), size, config, lambda _step, _share: None)
    one, other, again = (
        FrameSource(0, "differences").picture(view, number, config) for number in (0, 1, 0)
    )
    assert np.array_equal(one.image, again.image)
    assert not np.array_equal(one.image, other.image)
    assert one.image.mean() == pytest.approx(other.image.mean(), rel=0.1)
    assert one.cost.samples > 0.0
    assert one.cost.rays == 0.0


def test_a_reference_that_hides_the_error_is_refused(
    variant: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(run, "MOST_NOISE", 1e-6)
    assert run_small(tmp_path) == EXIT_BAD_INPUT
    assert "lost in the noise" in capsys.readouterr().err
    assert not (tmp_path / "fit.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cornell_box", "-o", "fit.txt"], "ends in .toml"),
        (["cornell_box"], "--output"),
        (["-o", "fit.toml"], "no scene"),
        (["nowhere.xml", "-o", "fit.toml"], "nowhere.xml"),
        (["cornell_box", "-o", "fit.toml", "--preset", "none.toml"], "cannot be read"),
        (["cornell_box", "-o", "fit.toml", "--preset", "best"], "no preset"),
        (["cornell_box", "-o", "fit.toml", "--method", "luck"], "gauss-newton"),
        (["cornell_box", "-o", "fit.toml", "--derivatives", "exact"], "forward"),
        (["cornell_box", "-o", "fit.toml", "--parameters", "colour"], "no parameter 'colour'"),
        (["cornell_box", "-o", "fit.toml", "--parameters", "cone_count"], "discrete"),
        (["cornell_box", "-o", "fit.toml", "--held-out", "cornell_box"], "trained on"),
        (["cornell_box", "-o", "fit.toml", "--frames", "1"], "own noise"),
        (["cornell_box", "-o", "fit.toml", "--spp", "12"], "multiple of 8"),
        (["cornell_box", "-o", "fit.toml", "--clipmap-resolution", "24"], "power of two"),
    ],
)
def test_bad_usage_is_one_line(
    arguments: list[str],
    words: str,
    variant: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["optimize", *arguments]) == EXIT_BAD_INPUT
    (line,) = [each for each in capsys.readouterr().err.splitlines() if each.startswith("vctgi: ")]
    assert words in line
    assert not [each for each in tmp_path.iterdir() if each.suffix == ".toml"]
