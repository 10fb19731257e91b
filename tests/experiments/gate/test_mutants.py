"""The shipped mutants: all are caught by a sane gate, and one that is let through is reported."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from experiments.gate.mutants import check_mutants, planted
from experiments.gate.update import baseline_from_record
from reports.record import FrameCost, MetricValue

if TYPE_CHECKING:
    from tests.experiments.gate.conftest import Bench

COST = FrameCost(
    gathering_cones=1,
    gathering_samples=1,
    specular_cones=0,
    specular_samples=0,
    near_field_rays=0,
    voxel_bytes=1000,
)
COUNT = MetricValue(
    name="launches", component="image", value=12.0, interval=None, formula="sum", ideal=0.0
)
SIMILARITY = MetricValue(
    name="ssim_pq", component="image", value=0.95, interval=None, formula="ssim", ideal=1.0
)


def test_every_mutant_of_every_kind_is_caught(bench: Bench, tmp_path: Path) -> None:
    energy = {"metric": "energy_ratio", "component": "indirect", "scale": "ratio"}
    gate = bench.gate(
        {"kind": "noninferior", **energy, "rel": 0.02},
        {"kind": "absolute", **energy, "low": 0.85, "high": 1.15},
        {"kind": "equal", **energy},
        {"kind": "exact", "metric": "launches", "component": "image"},
        {
            "kind": "noninferior",
            "metric": "ssim_pq",
            "component": "image",
            "scale": "similarity",
            "rel": 0.05,
            "noise": 0.01,
        },
        budget=[{"stage": "trace", "rel": 0.5}],
        memory={"rel": 0.1},
        smallest_difference=0.01,
    )
    source, _ = bench.record(seed=2, render=bench.truth, method="path", extra=[COUNT, SIMILARITY])
    record, path = bench.record(
        seed=3, render=bench.truth, method="path", extra=[COUNT, SIMILARITY]
    )
    source, record = (each.model_copy(update={"cost": COST}) for each in (source, record))
    baseline = baseline_from_record(gate, source, "bench")
    verdicts = check_mutants(record, path, gate, baseline, tmp_path / "scratch")
    assert [v.message for v in verdicts if not v.passed] == []
    kinds = {m.kind for m in planted(record, path, gate, baseline, tmp_path / "again")}
    assert kinds == {"finite", "exact", "noninferior", "absolute", "equal", "budget", "error"}
    # NaN, infinity, negative, scene, configuration; three ratios both ways; a count, a similarity,
    # a time, a size, noise
    assert len(verdicts) == 5 + 6 + 5


def test_a_mutant_that_gets_through_is_a_failure(bench: Bench, tmp_path: Path) -> None:
    gate = bench.gate()
    record, path = bench.record(seed=3)
    baseline = bench.baseline(gate)
    # A cap that was moved far away by hand, in the baseline and in the gate.
    (cap,) = [m for m in baseline.metrics if m.tolerance.kind == "absolute"][1:]
    loose = cap.tolerance.model_copy(update={"cap": 10.0})
    edited = baseline.model_copy(
        update={"metrics": [*baseline.metrics[:3], cap.model_copy(update={"tolerance": loose})]}
    )
    wide = gate.model_copy(update={"metrics": (*gate.metrics[:3], loose)})
    verdicts = check_mutants(record, path, wide, edited, tmp_path / "scratch")
    (survivor,) = [v for v in verdicts if not v.passed]
    assert survivor.kind == "mutant"
    assert "relmse_e2 of indirect" in survivor.gate
    assert "let this fault through" in survivor.message
