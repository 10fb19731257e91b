"""Each kind passes a good record and fails for its mutant."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from experiments.errors import InputError, MachineryError
from experiments.gate.evaluation import evaluate, exit_code
from experiments.gate.order import check_order
from experiments.gate.specification import GateSpec, Order
from experiments.gate.update import baseline_from_record
from reports.junit import Verdict
from reports.record import Interval, MetricValue, Record, write_image

if TYPE_CHECKING:
    from tests.experiments.gate.conftest import Bench

SMALLEST_THAT_MATTERS = 0.10
"""Rise of relMSE by the weakest fault that a gate must catch, relative."""
EQUAL: dict[str, object] = {
    "kind": "equal",
    "metric": "energy_ratio",
    "component": "indirect",
    "scale": "ratio",
}


def failures(verdicts: list[Verdict]) -> list[tuple[str, str]]:
    return [(v.kind, v.gate) for v in verdicts if not v.passed]


def judged(bench: Bench, record: Record, path: Path, gate: GateSpec | None = None) -> list[Verdict]:
    chosen = bench.gate() if gate is None else gate
    return evaluate(record, path, chosen, bench.baseline(chosen))


def replaced_metric(record: Record, **changes: object) -> Record:
    first, *others = record.metrics
    return record.model_copy(update={"metrics": [first.model_copy(update=changes), *others]})


def test_a_good_record_passes_every_check(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    verdicts = judged(bench, record, path)
    assert failures(verdicts) == []
    assert {v.kind for v in verdicts} == {"finite", "noise", "exact", "noninferior", "absolute"}
    assert exit_code(verdicts) == 0


def test_energy_times_1_05_fails(bench: Bench) -> None:
    record, path = bench.record(seed=3, render=bench.render * 1.05)
    assert ("noninferior", "bench: energy_ratio of indirect") in failures(
        judged(bench, record, path)
    )


def test_energy_lost_fails_too(bench: Bench) -> None:
    record, path = bench.record(seed=3, render=bench.render / 1.05)
    assert ("noninferior", "bench: energy_ratio of indirect") in failures(
        judged(bench, record, path)
    )


def test_the_smallest_rise_of_relmse_that_matters_fails(bench: Bench) -> None:
    error = bench.render - bench.truth
    worse = bench.truth + error * np.sqrt(1.0 + SMALLEST_THAT_MATTERS)
    record, path = bench.record(seed=3, render=worse)
    assert ("noninferior", "bench: relmse_e2 of indirect") in failures(judged(bench, record, path))


def test_half_the_error_passes(bench: Bench) -> None:
    error = bench.render - bench.truth
    gate = bench.gate(
        {"kind": "noninferior", "metric": "relmse_e2", "component": "indirect", "rel": 0.05}
    )
    record, path = bench.record(seed=3, render=bench.truth + 0.5 * error)
    assert failures(judged(bench, record, path, gate)) == []


def test_a_doubled_error_fails_its_cap(bench: Bench) -> None:
    error = bench.render - bench.truth
    record, path = bench.record(seed=3, render=bench.truth + np.sqrt(2.0) * error)
    assert ("absolute", "bench: relmse_e2 of indirect") in failures(judged(bench, record, path))


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e-3])
def test_one_bad_pixel_fails(bench: Bench, value: float) -> None:
    record, path = bench.record(seed=3)
    pixels = bench.render.copy()
    pixels[5, 7, 1] = value
    spoiled = write_image(bench.folder / "spoiled" / "image.exr", pixels, "one bad pixel")
    mutant = record.model_copy(update={"images": {**record.images, "image": spoiled}})
    verdicts = judged(bench, mutant, path)
    assert failures(verdicts) == [("finite", "bench: pictures")]
    assert verdicts[0].value == 1.0
    assert verdicts[0].message.startswith("image: ")


def test_the_signed_error_picture_may_be_negative(bench: Bench) -> None:
    assert (bench.render - bench.truth).min() < 0.0
    record, path = bench.record(seed=3)
    assert judged(bench, record, path)[0].passed


@pytest.mark.parametrize(
    ("changes", "item"),
    [
        ({"config": {"step_ratio": 0.25, "levels": 4}}, "configuration"),
        ({"method": "other"}, "method"),
    ],
)
def test_a_record_of_something_else_fails(
    bench: Bench, changes: dict[str, object], item: str
) -> None:
    record, path = bench.record(seed=3)
    verdicts = judged(bench, record.model_copy(update=changes), path)
    assert failures(verdicts) == [("exact", f"bench: {item}")]
    assert exit_code(verdicts) == 1


def test_a_wrong_scene_digest_fails(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    scene = record.scene.model_copy(update={"digest": "another scene"})
    verdicts = judged(bench, record.model_copy(update={"scene": scene}), path)
    assert failures(verdicts) == [("exact", "bench: scene digest")]


def test_the_order_of_config_keys_does_not_matter(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    turned = record.model_copy(update={"config": dict(reversed(record.config.items()))})
    assert failures(judged(bench, turned, path)) == []


def test_a_changed_formula_fails(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    verdicts = judged(bench, replaced_metric(record, formula="median(V) / median(R)"), path)
    assert {kind for kind, _ in failures(verdicts)} == {"noninferior", "absolute"}


def test_a_tolerance_widened_after_the_review_fails(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    narrow = bench.gate(
        {"kind": "noninferior", "metric": "relmse_e2", "component": "indirect", "rel": 0.04}
    )
    wide = bench.gate(
        {"kind": "noninferior", "metric": "relmse_e2", "component": "indirect", "rel": 0.05}
    )
    verdicts = evaluate(record, path, wide, bench.baseline(narrow))
    assert "tolerance was changed" in verdicts[-1].message
    assert exit_code(verdicts) == 1


def test_a_missing_baseline_fails_and_says_what_to_type(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    verdicts = evaluate(record, path, bench.gate(), None, update_command="vctgi gate x --update")
    assert failures(verdicts) == [("baseline", "bench: baseline")]
    assert "vctgi gate x --update" in next(v.message for v in verdicts if not v.passed)
    assert [v.kind for v in verdicts if v.kind == "absolute"] == ["absolute", "absolute"]


def test_an_interval_too_wide_to_decide_is_no_regression(bench: Bench) -> None:
    gate = bench.gate(
        {
            "kind": "noninferior",
            "metric": "energy_ratio",
            "component": "indirect",
            "scale": "ratio",
            "rel": 0.02,
        }
    )
    record, path = bench.record(seed=3)
    noisy = replaced_metric(record, interval=Interval(low=0.8, high=1.0))
    verdicts = judged(bench, noisy, path, gate)
    assert failures(verdicts) == [("error", "bench: energy_ratio of indirect")]
    assert exit_code(verdicts) == 3


def test_a_metric_that_is_not_there_is_refused(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    gate = bench.gate(
        {"kind": "noninferior", "metric": "flop", "component": "indirect", "rel": 0.02}
    )
    verdicts = evaluate(record, path, gate, bench.baseline(bench.gate()))
    assert "gate one of: energy_ratio of indirect" in verdicts[-1].message
    assert exit_code(verdicts) == 2


def test_a_wrong_scale_is_refused(bench: Bench) -> None:
    gate = bench.gate(
        {"kind": "noninferior", "metric": "energy_ratio", "component": "indirect", "rel": 0.02}
    )
    record, path = bench.record(seed=3)
    assert "set scale" in judged(bench, record, path, gate)[-1].message


def test_a_record_of_another_request_is_an_error(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    gate = bench.gate(reference_spp=1024)
    verdicts = evaluate(record, path, gate, None)
    assert failures(verdicts) == [("error", "bench: request")]


def test_a_metric_without_interval_needs_its_noise(bench: Bench) -> None:
    similarity = MetricValue(
        name="ssim_pq", component="image", value=0.95, interval=None, formula="ssim", ideal=1.0
    )
    keys = {
        "kind": "noninferior",
        "metric": "ssim_pq",
        "component": "image",
        "scale": "similarity",
        "rel": 0.05,
    }
    record, path = bench.record(seed=3, extra=[similarity])
    gate = bench.gate({**keys, "noise": 0.01})
    baseline = baseline_from_record(gate, record, "bench")
    assert failures(evaluate(record, path, gate, baseline)) == []
    # 1 - SSIM up by a tenth
    worse = similarity.model_copy(update={"value": 0.945})
    mutant, path = bench.record(seed=3, extra=[worse])
    assert exit_code(evaluate(mutant, path, gate, baseline)) == 1
    with pytest.raises(InputError, match="a gate compares intervals"):
        bench.baseline(bench.gate(keys), record)


def test_a_count_is_exact(bench: Bench) -> None:
    count = MetricValue(
        name="launches", component="image", value=12.0, interval=None, formula="sum", ideal=0.0
    )
    gate = bench.gate({"kind": "exact", "metric": "launches", "component": "image"})
    record, path = bench.record(seed=3, extra=[count])
    baseline = baseline_from_record(gate, record, "bench")
    assert exit_code(evaluate(record, path, gate, baseline)) == 0
    more, path = bench.record(seed=3, extra=[count.model_copy(update={"value": 13.0})])
    assert failures(evaluate(more, path, gate, baseline)) == [("exact", "bench: launches of image")]


def test_equality_holds_for_path_tracing_and_catches_five_per_cent(bench: Bench) -> None:
    gate = bench.gate(EQUAL)
    source, _ = bench.record(seed=2, render=bench.truth, method="path")
    baseline = baseline_from_record(gate, source, "bench")
    record, path = bench.record(seed=3, render=bench.truth, method="path")
    assert failures(evaluate(record, path, gate, baseline)) == []
    mutant, path = bench.record(seed=3, render=bench.truth * 1.05, method="path")
    assert failures(evaluate(mutant, path, gate, baseline)) == [
        ("equal", "bench: energy_ratio of indirect")
    ]


def test_equality_is_refused_for_a_biased_method(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    verdicts = judged(bench, record, path, bench.gate(EQUAL))
    assert "equality is for unbiased parts" in verdicts[-1].message
    assert exit_code(verdicts) == 2


def test_a_budget_holds_on_its_machine_and_advises_on_another(bench: Bench) -> None:
    gate = bench.gate(budget=[{"stage": "trace", "rel": 0.5}])
    baseline = bench.baseline(gate)
    record, path = bench.record(seed=3)
    slow = record.times[0].model_copy(update={"median_ms": 20.0, "low_ms": 19.0, "high_ms": 22.0})
    mutant = record.model_copy(update={"times": [slow]})
    assert failures(evaluate(mutant, path, gate, baseline)) == [("budget", "bench: time of trace")]
    elsewhere = mutant.machine.model_copy(update={"core_count": 64})
    verdict = evaluate(mutant.model_copy(update={"machine": elsewhere}), path, gate, baseline)[-1]
    assert verdict.passed
    assert "advisory, another machine: core_count 64 (baseline 2)" in verdict.message


def test_a_spread_that_reaches_under_the_limit_keeps_the_budget(bench: Bench) -> None:
    gate = bench.gate(budget=[{"stage": "trace", "rel": 0.5}])
    record, path = bench.record(seed=3)
    noisy = record.times[0].model_copy(update={"median_ms": 18.0, "low_ms": 14.0, "high_ms": 30.0})
    mutant = record.model_copy(update={"times": [noisy]})
    assert failures(evaluate(mutant, path, gate, bench.baseline(gate))) == []


def test_a_display_that_moved_fails_display_metrics_only(bench: Bench) -> None:
    def flip(start: float) -> MetricValue:
        return MetricValue(
            name="flip",
            component="image",
            value=0.1,
            interval=Interval(low=0.0995, high=0.1005),
            formula=f"mean HDR-FLIP(V, R), 3 exposures from {start:.3f} to 2.000 stops, ACES",
            ideal=0.0,
        )

    gate = bench.gate({"kind": "noninferior", "metric": "flip", "component": "image", "rel": 0.05})
    record, path = bench.record(seed=3, extra=[flip(-1.0)])
    baseline = baseline_from_record(gate, record, "bench")
    for start, expected in ((-1.005, []), (-1.3, [("exact", "bench: display")])):
        moved, path = bench.record(seed=3, extra=[flip(start)])
        display = moved.display.model_copy(update={"flip_start_exposure": start})
        mutant = moved.model_copy(update={"display": display})
        assert failures(evaluate(mutant, path, gate, baseline)) == expected
    lied, path = bench.record(seed=3, extra=[flip(-1.3)])
    assert failures(evaluate(lied, path, gate, baseline)) == [
        ("noninferior", "bench: flip of image")
    ]


def test_order_passes_fails_when_swapped_and_is_undecided_when_equal(bench: Bench) -> None:
    for metric, scale in (("relmse_e2", "error"), ("energy_ratio", "ratio")):
        order = Order.model_validate(
            {
                "name": "finer",
                "better": "fine",
                "worse": "coarse",
                "metric": metric,
                "component": "indirect",
                "scale": scale,
            }
        )
        coarse, _ = bench.record(seed=3)
        fine, _ = bench.record(seed=4, render=0.5 * (bench.render + bench.truth))
        assert check_order(order, fine, coarse).passed
        assert not check_order(order, coarse, fine).passed
        again, _ = bench.record(seed=5)
        with pytest.raises(MachineryError, match="the intervals overlap"):
            check_order(order, again, coarse)
