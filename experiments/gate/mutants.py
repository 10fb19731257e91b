"""Planted faults: each kind of gate must fail for its mutant, or it guards nothing."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from experiments.errors import MachineryError
from experiments.gate.baseline import Baseline
from experiments.gate.evaluation import ERROR, VOXEL_MEMORY, evaluate
from experiments.gate.fault import Fault
from experiments.gate.identity import SIGNED_IMAGES
from experiments.gate.noise import DIFFERENCE, check_noise
from experiments.gate.scales import metric_from_axis
from experiments.gate.specification import (
    SLOWDOWN,
    AnyMetricGate,
    Budget,
    EffectGate,
    GateSpec,
)
from experiments.gate.tolerance import effect_on_axis
from reports.junit import Verdict
from reports.record import (
    Interval,
    NoiseFloor,
    Record,
    load_image,
    write_image,
    write_record,
)
from reports.voxel_sheet import is_voxel_image

SPOILT: Final = {"one NaN": math.nan, "one infinity": math.inf, "one negative value": -1e-6}
"""Bad values of a picture."""


@dataclass(frozen=True)
class Mutant(Fault):
    """A record with one fault."""

    record: Record
    record_path: Path


def check_mutants(
    record: Record, record_path: Path, gate: GateSpec, baseline: Baseline, scratch: Path
) -> list[Verdict]:
    """Plant every mutant of a gate and demand that the right check fails.

    Parameters
    ----------
    record, record_path
        A good record and its file.
    gate, baseline
        What it is held to.
    scratch
        Empty folder for the altered pictures.

    Returns
    -------
    list of Verdict
        One of kind `mutant` per fault; failed when the fault went unnoticed.
    """
    verdicts = []
    for mutant in planted(record, record_path, gate, baseline, scratch):
        start = time.perf_counter()
        found = evaluate(mutant.record, mutant.record_path, gate, baseline)
        seconds = time.perf_counter() - start
        verdicts.append(mutant.judge(gate.name, gate.scene, found, seconds))
    return verdicts


def planted(
    record: Record, record_path: Path, gate: GateSpec, baseline: Baseline, scratch: Path
) -> Iterator[Mutant]:
    """Make the mutants of a gate, one fault each.

    One NaN, one infinity, one negative value in a picture; another scene; another configuration;
    each metric moved from its baseline by its weakest effect, ratios up and down; each budgeted
    stage at twice its time, as if on the baseline's machine; voxels of twice their size; a
    reference as noisy as the difference that it shows.
    """
    for name, value in SPOILT.items():
        yield plant_value(record, record_path, scratch / name.split()[-1], name, value)
    yield Mutant("other scene", "exact", "scene digest", plant_scene(record), record_path)
    yield Mutant("other configuration", "exact", "configuration", plant_config(record), record_path)
    for metric_gate in gate.metrics:
        item = f"{metric_gate.metric} of {metric_gate.component}"
        for sign in (1, -1) if getattr(metric_gate, "scale", None) == "ratio" else (1,):
            worse = plant_effect(record, metric_gate, baseline, sign)
            name = f"{item} moved {'up' if sign > 0 else 'down'} [{metric_gate.kind}]"
            yield Mutant(name, metric_gate.kind, item, worse, record_path)
    for budget in gate.budgets:
        slow = plant_slowdown(record, budget, baseline)
        name = f"{budget.stage} at {SLOWDOWN:g} x its time"
        yield Mutant(name, "budget", f"time of {budget.stage}", slow, record_path)
    if gate.memory is not None:
        grown = plant_growth(record, baseline)
        name = f"voxels at {SLOWDOWN:g} x their size"
        yield Mutant(name, "budget", VOXEL_MEMORY, grown, record_path)
    if _is_told_apart(record, gate):
        noisy = plant_noise(record, gate)
        yield Mutant("reference as noisy as its error", ERROR, "noise", noisy, record_path)


def plant_value(
    record: Record, record_path: Path, scratch: Path, name: str, value: float
) -> Mutant:
    """Copy a record with all its pictures and put one bad value into the first of radiance."""
    spoiled = min(
        image for image in record.images if image not in SIGNED_IMAGES and not is_voxel_image(image)
    )
    files = {}
    for image, file in record.images.items():
        pixels = load_image(record_path, record, image).copy()
        if image == spoiled:
            pixels.reshape(-1)[pixels.size // 2] = value
        target = scratch / record.record_id / f"{image}.exr"
        files[image] = write_image(target, pixels, file.description)
    copy = record.model_copy(update={"images": files})
    path = write_record(copy, scratch)
    return Mutant(f"{name} in {spoiled}", "finite", "pictures", copy, path)


def plant_scene(record: Record) -> Record:
    """Give a record the digest of another scene."""
    scene = record.scene.model_copy(update={"digest": f"mutant-{record.scene.digest}"})
    return record.model_copy(update={"scene": scene})


def plant_config(record: Record) -> Record:
    """Give a record another configuration."""
    return record.model_copy(update={"config": {**record.config, "mutant": True}})


def plant_effect(record: Record, gate: AnyMetricGate, baseline: Baseline, sign: int = 1) -> Record:
    """Move a metric from its baseline's value by its gate's weakest effect.

    The interval's width is the record's. A metric of an `exact` gate moves by one.
    """
    entry = baseline.metric_for(gate)
    assert entry is not None, f"the baseline lacks {gate.metric} of {gate.component}"
    metrics = list(record.metrics)
    for index, metric in enumerate(metrics):
        if (metric.name, metric.component) != (gate.metric, gate.component):
            continue
        if not isinstance(gate, EffectGate):
            metrics[index] = metric.model_copy(update={"value": entry.value + 1.0})
            continue
        before = entry.estimate()
        position = before.value + sign * effect_on_axis(gate, before)
        value = metric_from_axis(gate.scale, position)
        interval = metric.interval
        if interval is not None:
            # A ratio's interval scales with it; the others' only move.
            factor = value / metric.value if gate.scale == "ratio" else 1.0
            interval = Interval(
                low=value - factor * (metric.value - interval.low),
                high=value + factor * (interval.high - metric.value),
                level=interval.level,
            )
        metrics[index] = metric.model_copy(update={"value": value, "interval": interval})
    return record.model_copy(update={"metrics": metrics})


def plant_slowdown(record: Record, budget: Budget, baseline: Baseline) -> Record:
    """Give a stage twice its baseline's time, on the baseline's machine."""
    entry = next(stored for stored in baseline.times if stored.stage == budget.stage)
    times = [
        time.model_copy(
            update={
                "median_ms": SLOWDOWN * entry.median_ms,
                "low_ms": SLOWDOWN * entry.low_ms,
                "high_ms": SLOWDOWN * entry.high_ms,
            }
        )
        if time.stage == budget.stage
        else time
        for time in record.times
    ]
    same = ("device", "processor", "core_count")
    machine = record.machine.model_copy(
        update={name: getattr(baseline.environment, name) for name in same}
    )
    return record.model_copy(update={"times": times, "machine": machine})


def plant_growth(record: Record, baseline: Baseline) -> Record:
    """Give a record voxels of twice the baseline's size."""
    assert record.cost is not None, "the memory was found before"
    assert baseline.voxel_bytes is not None, "the baseline lacks the size of the voxels"
    grown = round(SLOWDOWN * baseline.voxel_bytes)
    return record.model_copy(update={"cost": record.cost.model_copy(update={"voxel_bytes": grown})})


def _is_told_apart(record: Record, gate: GateSpec) -> bool:
    """Say whether the gate found the noise of the reference low enough, so that it can rise."""
    try:
        return check_noise(record, gate) is not None
    except MachineryError:
        return False


def plant_noise(record: Record, gate: GateSpec) -> Record:
    """Give a record a reference whose noise is as large as the difference asked about."""
    assert record.reference is not None, "a record without a reference has no noise to judge"
    differences = {m.component: m.value for m in record.metrics if m.name == DIFFERENCE}
    floors = {}
    for component in record.reference.noise_floors:
        size = gate.smallest_difference or abs(differences.get(component, 0.0))
        floors[component] = NoiseFloor(value=size, upper=size)
    noisy = record.reference.model_copy(update={"noise_floors": floors})
    return record.model_copy(update={"reference": noisy})
