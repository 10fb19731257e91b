"""The study of the gates, on pictures that are drawn and not rendered."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from experiments.gate.evaluation import exit_code
from experiments.gate.update import baseline_from_record
from experiments.studies.catalogue import STUDIES, checks_of
from experiments.studies.gates.alarms import (
    RESOLUTION,
    leaked_light,
    run_gates,
    share_with_interval,
    smallest_found,
)
from experiments.studies.gates.draws import BATCHES_EACH, draw, gate_of, judge, record_of
from experiments.studies.gates.pool import Pool
from reports.record import Machine, write_image

SIZE, SPP = 16, 512


@pytest.fixture
def pool(tmp_path: Path) -> Pool:
    """Hand out a pool of a picture that is 7 % too dark, with little noise on both sides."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    truth = (0.2 + np.exp(-3.0 * ((x - 0.4) ** 2 + y**2)))[..., None] * np.array([0.9, 0.7, 0.5])
    pattern = 0.93 + 0.1 * np.sin(9.0 * x) * np.cos(7.0 * y)
    light = truth * pattern[..., None]
    frames = light * (1.0 + 1e-4 * rng.standard_normal((8, *light.shape)))
    batches = truth * (1.0 + 5e-3 * rng.standard_normal((20, *light.shape)))
    return Pool(
        frames=frames,
        images=[
            {"indirect": write_image(tmp_path / f"frame{i}" / "indirect.exr", each, "light")}
            for i, each in enumerate(frames)
        ],
        times=rng.uniform(9.0, 11.0, 8),
        batches=batches,
        batch_spp=SPP,
        machine=Machine(
            backend="llvm_ad_rgb",
            device="cpu",
            processor="bench",
            core_count=2,
            memory_gib=8.0,
            system="Linux",
            python="3.11",
            versions={},
            commit="0" * 40,
            is_dirty=False,
        ),
        folder=tmp_path,
    )


def test_both_sides_of_a_draw_share_nothing(pool: Pool) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        drawn = draw(pool, rng)
        first, second = drawn.baseline, drawn.record
        assert not set(first.batches) & set(second.batches)
        assert len(first.batches) == len(second.batches) == BATCHES_EACH
        assert first.frame != second.frame
        assert not set(first.timed) & set(second.timed)


def test_an_unchanged_renderer_raises_no_alarm_and_a_fault_is_found(pool: Pool) -> None:
    found = run_gates(pool, quick=False, progress=lambda _step, _share: None, count=10)
    assert len(found.runs) == 10
    assert [run.alarms for run in found.runs] == [frozenset()] * 10
    # The tolerance of the energy, rel 0.02, is the largest that could be needed
    assert 0.0 < found.smallest["more energy"] < 0.03
    assert 0.0 < found.smallest["less energy"] < 0.03


def test_the_gate_is_the_one_that_is_run(pool: Pool) -> None:
    """Energy times 1.05 fails it, and the record itself passes."""
    gate = gate_of(False, SIZE, BATCHES_EACH * SPP)
    drawn = draw(pool, np.random.default_rng(3))
    baseline = baseline_from_record(gate, record_of(pool, drawn.baseline), "here")
    assert exit_code(judge(pool, gate, baseline, record_of(pool, drawn.record))) == 0
    worse = record_of(pool, drawn.record, fault=lambda light, _: 1.05 * light)
    assert exit_code(judge(pool, gate, baseline, worse)) == 1


def test_leaked_light_adds_the_share_that_it_is_named_for(pool: Pool) -> None:
    light, truth = pool.frames[0], pool.batches.mean(axis=0)
    leaked = leaked_light(0.02)(light, truth)
    assert leaked.mean() == pytest.approx(1.02 * light.mean(), rel=1e-12)
    changed = (leaked != light).any(axis=2)
    assert changed.mean() == pytest.approx(0.25, abs=0.01)
    assert truth.mean(axis=2)[changed].max() <= truth.mean(axis=2)[~changed].min()


def test_the_smallest_fault_is_where_nineteen_of_twenty_runs_find_it() -> None:
    assert smallest_found(lambda share: share / 0.02, 0.1) == pytest.approx(0.019, abs=RESOLUTION)
    assert math.isnan(smallest_found(lambda _share: 0.9, 0.1))


@pytest.mark.parametrize(("count", "total"), [(0, 200), (2, 200), (200, 200)])
def test_the_interval_is_the_exact_one_of_a_binomial(count: int, total: int) -> None:
    found = share_with_interval(count, total)
    exact = stats.binomtest(count, total).proportion_ci(method="exact")
    assert found.low == pytest.approx(exact.low, abs=1e-9)
    assert found.high == pytest.approx(exact.high, abs=1e-9)


def test_all_its_checks_are_in_the_quick_version(variant: str) -> None:
    assert all(check.in_quick for check in checks_of(STUDIES["gates"]))
