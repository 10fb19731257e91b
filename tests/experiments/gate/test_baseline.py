"""Baselines: written only when asked and sane, read back as they were, one file each."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from experiments.errors import InputError, MachineryError
from experiments.gate.baseline import (
    baseline_path,
    config_hash,
    pinned_display,
    read_baseline,
)
from experiments.gate.evaluation import evaluate
from experiments.gate.update import update_baselines

if TYPE_CHECKING:
    from tests.experiments.gate.conftest import Bench


def test_a_written_baseline_reads_back_and_passes_its_own_record(
    bench: Bench, tmp_path: Path
) -> None:
    gate = bench.gate(budget=[{"stage": "trace", "rel": 0.5}])
    record, record_path = bench.record(seed=2)
    (path,) = update_baselines([(gate, record, record_path)], tmp_path / "new", " first  ")
    assert path == tmp_path / "new" / "bench.medium.llvm_ad_rgb.json"
    assert path == baseline_path(tmp_path / "new", gate, "llvm_ad_rgb")
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    baseline = read_baseline(path)
    assert baseline is not None
    assert baseline.reason == "first"
    assert baseline.config_hash == config_hash(record.config)
    assert pinned_display(path.parent, gate, "llvm_ad_rgb") == record.display
    assert all(verdict.passed for verdict in evaluate(record, record_path, gate, baseline))


def test_a_baseline_holds_what_a_reviewer_must_see(bench: Bench, tmp_path: Path) -> None:
    record, record_path = bench.record(seed=2)
    (path,) = update_baselines([(bench.gate(), record, record_path)], tmp_path, "first")
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["schema_version"] == 1
    assert content["scene_digest"] == "digest-of-bench"
    assert content["reference"]["samples_per_pixel"] == 512
    assert content["reference"]["seed"] == 2
    assert content["display"]["flip_exposure_count"] == 3
    assert content["environment"]["versions"] == {"mitsuba": "3.9.1", "drjit": "1.5.0"}
    first = content["metrics"][0]
    assert first["low"] < first["value"] < first["high"]
    assert first["tolerance"]["rel"] == 0.02
    assert first["formula"].startswith("mean(V) / mean(R)")


def test_no_reason_no_baseline(bench: Bench, tmp_path: Path) -> None:
    record, record_path = bench.record(seed=2)
    with pytest.raises(InputError, match="no reason"):
        update_baselines([(bench.gate(), record, record_path)], tmp_path / "new", "  ")
    assert not (tmp_path / "new").exists()


def test_a_record_beyond_its_cap_makes_no_baseline(bench: Bench, tmp_path: Path) -> None:
    gate = bench.gate(
        {"kind": "absolute", "metric": "relmse_e2", "component": "indirect", "cap": 0.001}
    )
    record, record_path = bench.record(seed=2)
    with pytest.raises(InputError, match="beyond the limit"):
        update_baselines([(gate, record, record_path)], tmp_path / "new", "why")
    assert not (tmp_path / "new").exists()


def test_a_noisy_reference_makes_no_baseline(bench: Bench, tmp_path: Path) -> None:
    bench.batch_noise = 0.2
    record, record_path = bench.record(seed=2)
    with pytest.raises(MachineryError, match="raise the reference samples"):
        update_baselines([(bench.gate(), record, record_path)], tmp_path, "why")


def test_nothing_is_written_when_one_of_several_is_refused(bench: Bench, tmp_path: Path) -> None:
    good = bench.gate()
    bad = bench.gate({"kind": "exact", "metric": "none", "component": "image"}, name="bad")
    record, record_path = bench.record(seed=2)
    with pytest.raises(InputError, match="0 values of none of image"):
        update_baselines(
            [(good, record, record_path), (bad, record, record_path)], tmp_path / "new", "why"
        )
    assert not (tmp_path / "new").exists()


def test_a_missing_baseline_is_none_and_a_broken_one_is_named(tmp_path: Path) -> None:
    assert read_baseline(tmp_path / "none.json") is None
    broken = tmp_path / "broken.json"
    broken.write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="broken baseline: gate: Field required"):
        read_baseline(broken)
    broken.write_text("not JSON", encoding="utf-8")
    with pytest.raises(InputError, match="broken baseline"):
        read_baseline(broken)


def test_a_folder_that_cannot_be_written_is_named(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    record, record_path = bench.record(seed=2)
    with pytest.raises(MachineryError, match="cannot write the baseline"):
        update_baselines([(bench.gate(), record, record_path)], tmp_path / "file", "why")


def test_the_gate_needs_no_renderer() -> None:
    """A record is judged where none can be made."""
    code = "import sys, experiments.gate; print({'mitsuba', 'drjit'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
