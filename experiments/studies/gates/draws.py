"""Draws of a baseline and a record from the pool, and what the gates say to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from experiments.gate.baseline import Baseline
from experiments.gate.budget import check_budget
from experiments.gate.evaluation import evaluate, verdict_of
from experiments.gate.order import check_order
from experiments.gate.specification import Budget, GateSpec, Order
from experiments.gate.update import baseline_from_record
from experiments.noise import noise_floors
from experiments.record import metric_value
from experiments.studies.gates.pool import PRESET, SCATTERINGS, SCENE, STAGE, Pool
from metrics.energy import energy_ratio
from metrics.measurement import Measurement
from metrics.squared_error import mse, relmse_e2
from reports.junit import Verdict
from reports.record import (
    Display,
    Record,
    ReferenceInfo,
    SceneInfo,
    StageTime,
)

BATCHES_EACH, FRAMES_EACH = 8, 3
"""Batches of a reference and frames that are timed, as `vctgi gate` has them."""

DARKER: Final = 0.9
"""Energy of the picture that the gate `order` must find worse than the other."""

QUICK_WIDTH: Final = 8.0
"""Tolerance of the error in the quick version over that of the gate; 4, the square root of the
paths, is the least, at which nearly all baselines are refused as too noisy."""

Fault = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Puts a fault into indirect light [y, x, rgb]; also given the reference."""


@dataclass(frozen=True)
class Side:
    """What one of the two, baseline or record, is made of: places in the pool."""

    batches: tuple[int, ...]
    frame: int
    timed: tuple[int, ...]


@dataclass(frozen=True)
class Draw:
    """A baseline and a record of one unchanged renderer."""

    baseline: Side
    record: Side


def draw(pool: Pool, rng: np.random.Generator) -> Draw:
    """Draw without replacement, so that baseline and record share no batch and no frame."""
    batches = rng.permutation(len(pool.batches))[: 2 * BATCHES_EACH].tolist()
    frames = rng.permutation(len(pool.frames))[:2].tolist()
    timed = rng.permutation(len(pool.times))[: 2 * FRAMES_EACH].tolist()
    first, second = (Side(tuple(batches[i::2]), frames[i], tuple(timed[i::2])) for i in range(2))
    return Draw(first, second)


def gate_of(quick: bool, edge: int, spp: int) -> GateSpec:
    """Return the gate: that of tests/gates on the Cornell box, and a metric of each other kind.

    The quick version has a 16th of the paths and a quarter of the pixels, at each fourth of which
    cones start, and so wider tolerances: with those of the gate, 3 % of 200 runs were false alarms.
    """
    wide = QUICK_WIDTH if quick else 1.0
    stated = {"effect_from": "wider for a quick reference"} if quick else {}
    energy = {"metric": "energy_ratio", "component": "indirect", "scale": "ratio"}
    error = {"metric": "mse", "component": "indirect"}
    energy_effect = {"effect": 0.1, **stated} if quick else {}
    error_effect = {"effect": 0.10 * wide, **stated} if quick else {}
    return GateSpec.model_validate(
        {
            "name": "cornell_box",
            "scene": SCENE,
            "preset": PRESET,
            "width": edge,
            "height": edge,
            "reference_spp": spp,
            "metric": [
                {"kind": "noninferior", "rel": 0.04 if quick else 0.02, **energy, **energy_effect},
                {"kind": "noninferior", "rel": 0.05 * wide, **error, **error_effect},
                {"kind": "absolute", "low": 0.85, "high": 1.1, **energy},
            ],
        }
    )


EQUAL_GATE: Final = {
    "kind": "equal",
    "metric": "energy_ratio",
    "component": "indirect",
    "scale": "ratio",
}
BUDGET: Final = Budget(stage=STAGE, rel=0.5)
ORDER: Final = Order(
    name="darker_is_worse",
    better="cornell_box",
    worse="darker",
    metric="mse",
    component="indirect",
)


def record_of(
    pool: Pool, side: Side, *, fault: Fault | None = None, frame: int | None = None
) -> Record:
    """Make the record of one side.

    Parameters
    ----------
    pool, side
        What it is drawn from, and what was drawn.
    fault
        Changes the light before it is measured.
    frame
        Another frame than the one drawn.
    """
    chosen = side.frame if frame is None else frame
    light = pool.frames[chosen].astype(np.float64)
    batches = pool.batches[list(side.batches)].astype(np.float64)
    if fault is not None:
        light = fault(light, batches.mean(axis=0))
    height, width = light.shape[:2]
    spp = pool.batch_spp * len(batches)
    timed = pool.times[list(side.timed)]
    return Record(
        record_id=f"draw-{chosen}",
        created="2026-01-31T12:00:00+00:00",
        command="vctgi study gates",
        scene=CORNELL,
        method="voxel cone tracing",
        preset=PRESET,
        config={},
        plan=[],
        seed=chosen,
        width=width,
        height=height,
        reference=ReferenceInfo(
            key="-".join(map(str, side.batches)),
            samples_per_pixel=spp,
            batch_count=len(batches),
            scattering_count=SCATTERINGS,
            seed=0,
            seconds=0.0,
            from_cache=True,
            noise_relmse=None,
            noise_floors=noise_floors({"indirect": batches}, spp),
            truncated_share=0.0,
        ),
        metrics=[metric_value(each(light, batches)) for each in (_energy, _mse, _relmse)],
        times=[
            StageTime(
                stage=STAGE,
                median_ms=float(np.median(timed)),
                low_ms=float(timed.min()),
                high_ms=float(timed.max()),
                count=len(timed),
            )
        ],
        images=pool.images[chosen],
        machine=pool.machine,
        display=DISPLAY,
        warnings=[],
    )


def judge(pool: Pool, gate: GateSpec, baseline: Baseline, record: Record) -> list[Verdict]:
    """Say what the gate says to a record, its picture being that of the frame it is from."""
    return evaluate(record, pool.folder / "record.json", gate, baseline)


def judge_order(pool: Pool, gate: GateSpec, side: Side) -> Verdict:
    """Compare a record with a darker picture of the same reference."""
    better = record_of(pool, side)
    worse = record_of(pool, side, fault=lambda light, _: DARKER * light)
    return verdict_of(gate, "order", lambda: check_order(ORDER, better, worse))


def judge_time(pool: Pool, drawn: Draw) -> Verdict | None:
    """Hold the time of the stage to its budget; None where the baseline is refused as too noisy.

    On a machine that others use, too, times spread by more than the fault that a budget must find.
    """
    gate = gate_of(False, pool.frames.shape[1], 1)
    before, after = (record_of(pool, side) for side in (drawn.baseline, drawn.record))
    budgeted = gate.model_copy(update={"metrics": (), "budgets": (BUDGET,)})
    baseline = baseline_from_record(budgeted, before, "drawn")
    if not verdict_of(gate, "budget", lambda: check_budget(BUDGET, before, baseline)).passed:
        return None
    return verdict_of(gate, "budget", lambda: check_budget(BUDGET, after, baseline))


def judge_equal(pool: Pool, gate: GateSpec, drawn: Draw) -> list[Verdict]:
    """Test one picture, declared to be path-traced, against two references.

    The interval of a record knows nothing of the picture's own noise, so the picture is the same.
    """
    alone = gate.model_copy(
        update={
            "metrics": GateSpec.model_validate({**_plain(gate), "metric": [EQUAL_GATE]}).metrics,
            "budgets": (),
        }
    )
    before, after = (
        record_of(pool, side, frame=drawn.record.frame).model_copy(update={"method": "path"})
        for side in (drawn.baseline, drawn.record)
    )
    return judge(pool, alone, baseline_from_record(alone, before, "drawn"), after)


def _plain(gate: GateSpec) -> dict[str, object]:
    names = ("name", "scene", "preset", "width", "height", "reference_spp")
    return {name: getattr(gate, name) for name in names}


def _energy(light: np.ndarray, batches: np.ndarray) -> Measurement:
    return energy_ratio(light, batches, component="indirect")


def _mse(light: np.ndarray, batches: np.ndarray) -> Measurement:
    return mse(light, batches, component="indirect")


def _relmse(light: np.ndarray, batches: np.ndarray) -> Measurement:
    return relmse_e2(light, batches, component="indirect")


def failed_kinds(verdicts: Sequence[Verdict]) -> set[str]:
    """Return the kinds of the verdicts that failed."""
    return {verdict.kind for verdict in verdicts if not verdict.passed}


CORNELL: Final = SceneInfo(
    name=SCENE,
    title="Cornell box",
    source=SCENE,
    purpose="false alarms",
    digest=SCENE,
    triangle_count=0,
    emitters={},
    bsdfs={},
    bounds_min=(0.0, 0.0, 0.0),
    bounds_max=(1.0, 1.0, 1.0),
    contributions=[],
    unsupported=[],
)
DISPLAY: Final = Display(
    nits_per_unit=100.0,
    exposure=0.0,
    flip_start_exposure=-1.0,
    flip_stop_exposure=2.0,
    flip_exposure_count=3,
    flip_pixels_per_degree=67.0,
)
