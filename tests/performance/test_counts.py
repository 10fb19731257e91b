"""What a small frame does, on any machine: texels, bytes, launches, samples of cones.

The baseline is made by

    vctgi bench cornell_box --preset high --resolution 32x24 --voxels 16 --levels 2 --frames 0 \
        --variant llvm_ad_rgb --json tests/performance/cornell_box.llvm_ad_rgb.json

that of glossy_floor alike; they are made anew, with a reason in the commit, where more work buys
something.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from experiments.bench.comparison import DEFAULT_BOUND, OPERATIONS_BOUND, compare, counts_of
from experiments.cli import main
from experiments.doctor import LLVM_VARIANT
from experiments.errors import EXIT_DONE, EXIT_FAILED, InputError
from reports.bench_record import BenchRecord, bench_text, read_bench

BASELINE = Path(__file__).parent / "cornell_box.llvm_ad_rgb.json"

GLOSSY = Path(__file__).parent / "glossy_floor.llvm_ad_rgb.json"
"""The same of a scene with specular cones, whose kernels take longer to compile."""

OPTIONS = (
    *("--preset", "high", "--resolution", "32x24"),
    *("--voxels", "16", "--levels", "2", "--frames", "0", "--baseline"),
)
COMMAND = ("bench", "cornell_box", *OPTIONS)


def with_counts(record: BenchRecord, share: float, what: str) -> BenchRecord:
    """Return a record of which all counts of a kind are larger by a share."""
    text = record.model_dump()
    for frames in text["presets"][0]["frames"]:
        for stage in frames["stages"]:
            stage["counts"][what] = round(stage["counts"][what] * (1.0 + share))
    return BenchRecord.model_validate(text)


@pytest.mark.parametrize(
    ("scene", "baseline"),
    [("cornell_box", BASELINE), pytest.param("glossy_floor", GLOSSY, marks=pytest.mark.slow)],
)
def test_a_small_frame_does_no_more_than_its_baseline(
    variant: str, scene: str, baseline: Path
) -> None:
    if variant != LLVM_VARIANT:
        pytest.skip("the baseline is that of LLVM")
    command = ["bench", scene, *OPTIONS, str(baseline), "--variant", variant]
    # A process of its own: scenes of other tests add their materials to every call of materials.
    done = subprocess.run(
        [sys.executable, "-m", "experiments", *command], capture_output=True, text=True, check=False
    )
    grown = [line for line in done.stdout.splitlines() if "MORE WORK" in line]
    assert grown == []
    assert done.returncode == EXIT_DONE, done.stderr


@pytest.mark.parametrize("what", ["texel_reads", "bytes", "launches", "operations"])
def test_more_work_is_found_and_named(what: str) -> None:
    before = read_bench(BASELINE)
    found = compare(before, with_counts(before, 0.5, what)).regressions
    assert found
    assert all(each.growth > DEFAULT_BOUND for each in found)
    assert any(f"tracing, {what.replace('_', ' ')}" in each.line() for each in found)


def test_less_work_and_rounding_pass() -> None:
    before = read_bench(BASELINE)
    for share in (-0.2, 0.5 * DEFAULT_BOUND):
        found = compare(before, with_counts(before, share, "texel_reads"))
        assert not found.regressions
        assert found.changes


def test_code_may_be_rewritten_and_not_doubled() -> None:
    before = read_bench(BASELINE)
    for share, is_worse in ((0.5 * OPERATIONS_BOUND, False), (1.0, True)):
        after = with_counts(before, share, "operations")
        assert bool(compare(before, after).regressions) == is_worse


def test_a_stage_that_is_new_is_more_work() -> None:
    after = read_bench(BASELINE)
    text = after.model_dump()
    text["presets"][0]["frames"][0]["stages"].pop(0)
    lines = compare(BenchRecord.model_validate(text), after).lines()
    assert any("MORE WORK" in line and "(new)" in line for line in lines)


def test_samples_of_cones_are_counts() -> None:
    counts = counts_of(read_bench(BASELINE))
    assert counts["high, gathering samples"] > counts["high, gathering cones"] > 0


def test_other_work_is_not_compared() -> None:
    before = read_bench(BASELINE)
    with pytest.raises(InputError, match="scene"):
        compare(before, before.model_copy(update={"scene": "another"}))


def test_the_command_fails_where_counts_grew(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if variant != LLVM_VARIANT:
        pytest.skip("the baseline is that of LLVM")
    cheaper = tmp_path / "cheaper.json"
    cheaper.write_text(bench_text(with_counts(read_bench(BASELINE), -0.5, "texel_reads")))
    assert main([*COMMAND, str(cheaper), "--variant", variant]) == EXIT_FAILED
    assert "MORE WORK  high, still, tracing, texel reads" in capsys.readouterr().out


def test_a_file_that_is_no_record_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "wrong.json"
    wrong.write_text("{}")
    assert main(["bench", "cornell_box", "--baseline", str(wrong)]) == 2
    assert "not the record of a benchmark" in capsys.readouterr().err
