"""Light that changes over time: ripples and pops of known size."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np

from experiments.studies.check import Measured
from experiments.studies.validation.subject import Interval, Subject
from metrics.aliasing import (
    pop_share,
    power_ripple,
    recentring_difference,
    temporal_difference_error,
    temporal_difference_rms,
)
from metrics.measurement import Measurement
from metrics.synthetic import (
    Noise,
    SteadySweep,
    splatted_light,
    steady_sweep,
)
from metrics.voxel_period import voxel_period_rms, voxel_period_share

PHASES, PERIODS, RECEIVERS, BATCHES = 16, 2, 20, 6
AMPLITUDE = 0.1
"""Of the known ripple, over the mean light."""

AMPLITUDES = (0.0, 0.02, 0.05, 0.1, 0.2)
FILTERS = (3.0, 2.0, 1.0)
"""Voxels that share a moving light, fewer and fewer."""

OWN_NOISE = 0.1
"""Share of the noise that frames do not have in common: a batch's frames share random numbers."""

ROUNDING = 1e-9
SINE_ROUNDING = 5e-3
"""Of the mean absolute value of a sine at 20 places, relative."""

SWEEP = f"{RECEIVERS} receivers, {PERIODS} voxels in {PHASES * PERIODS} frames, {BATCHES} batches"

Measure = Callable[..., Measurement]


def subjects() -> list[Subject]:
    """Return the metrics of what moves."""
    return [_power(), *_differences(), *_filtered(), _pops(), _recentring()]


@cache
def sweep() -> SteadySweep:
    """Return the sweep of all rows."""
    return steady_sweep(PHASES, PERIODS, RECEIVERS)


def _power() -> Subject:
    def measure(amplitude: float, noise: Noise, seed: int) -> Interval:
        turns = 2.0 * np.pi * np.arange(PHASES) / PHASES
        powers = 3.0 * (1.0 + amplitude * np.sin(turns))
        return power_ripple(powers * noise(np.random.default_rng(seed), (8, PHASES)))

    return Subject(
        name="I1 power ripple",
        case="power at 16 places, a sine, in 8 repetitions",
        cause="the amplitude",
        measure=measure,
        causes=AMPLITUDES,
        known=AMPLITUDE,
        answer=2.0 * AMPLITUDE,
        tolerance=ROUNDING,
        broken=lambda: power_ripple([1.0, np.nan]),
        faults={"a ripple of 0.5": (0.0, 0.5)},
    )


def _in_sweep(cause: float, noise: Noise, seed: int, *, metric: Measure) -> Interval:
    return metric(sweep().rippled(cause), sweep().batches(BATCHES, noise, seed, OWN_NOISE))


def _with_nan(metric: Measure) -> Callable[[], object]:
    def broken() -> object:
        found = sweep().truth.copy()
        found[3, 4, 1] = np.nan
        return metric(found, np.stack([sweep().truth] * BATCHES))

    return broken


def _differences() -> list[Subject]:
    # A sine that advances by 1/16 of a turn changes by 2 sin(pi/16) of its amplitude; the mean of
    # its absolute value is 2/pi, that of its square a half.
    step = 2.0 * math.sin(math.pi / PHASES) * AMPLITUDE
    places = sweep().places
    rows: dict[str, tuple[Measure, float, float]] = {
        "I2 mean": (temporal_difference_error, step * 2.0 / math.pi, SINE_ROUNDING),
        "I2 RMS": (temporal_difference_rms, step / math.sqrt(2.0), ROUNDING),
        "voxel period, RMS": (
            partial(voxel_period_rms, places=places),
            AMPLITUDE / math.sqrt(2.0),
            ROUNDING,
        ),
    }
    return [
        Subject(
            name=name,
            case=f"{SWEEP}; a sine of one voxel's length, phases spread",
            cause="the amplitude",
            measure=partial(_in_sweep, metric=metric),
            causes=AMPLITUDES,
            known=AMPLITUDE,
            answer=answer,
            tolerance=tolerance,
            broken=_with_nan(metric),
            faults={"a ripple of 0.2": (0.0, 0.2)},
        )
        for name, (metric, answer, tolerance) in rows.items()
    ] + [_period_share()]


def _period_share() -> Subject:
    """Share of waves beside others that beat with the voxel: 1 in all, by their powers."""

    def measure(part: float, noise: Noise, seed: int) -> Interval:
        # Both waves fit into the sweep a whole number of times and are orthogonal.
        other = sweep().rippled(AMPLITUDE * math.sqrt(1.0 - part), period=PERIODS / 11.0)
        found = sweep().rippled(AMPLITUDE * math.sqrt(part)) + other - sweep().truth
        batches = sweep().batches(BATCHES, noise, seed, OWN_NOISE)
        return voxel_period_share(found, batches, sweep().places)

    return Subject(
        name="voxel period, share of energy",
        case=f"{SWEEP}; a sine of one voxel's length",
        cause="its share",
        measure=measure,
        causes=(0.1, 0.3, 0.6, 1.0),
        known=1.0,
        answer=1.0,
        tolerance=ROUNDING,
        zero=None,
        broken=_with_nan(partial(voxel_period_share, places=sweep().places)),
        faults={"all energy at the voxel, from a tenth": (0.1, 1.0)},
    )


def _filtered() -> list[Subject]:
    """Rows of a light that voxels hold with a pre-filter or without."""
    places = sweep().places

    def measure(width: float, noise: Noise, seed: int, *, metric: Measure) -> Interval:
        found, truth = splatted_light(places, RECEIVERS, int(width))
        still = SteadySweep(places=places, truth=truth)
        return metric(found, still.batches(BATCHES, noise, seed, OWN_NOISE))

    metrics: dict[str, Measure] = {
        "I2 RMS": temporal_difference_rms,
        "voxel period, RMS": partial(voxel_period_rms, places=places),
    }
    found = []
    for name, metric in metrics.items():
        of = partial(measure, metric=metric)
        found.append(
            Subject(
                name=f"{name}, of a light splatted into voxels",
                case=f"{SWEEP}; spline of 3, 2 or 1 voxels",
                cause="the narrowness of the pre-filter",
                measure=of,
                causes=FILTERS,
                known=1.0,
                answer=of(1.0, lambda _, shape: np.ones(shape), 0).value,
                tolerance=ROUNDING,
                zero=None,
                noises={},
                broken=_with_nan(metric),
                faults={"no pre-filter": (3.0, 1.0)},
                has_interval=False,
            )
        )
    return found


def _pops() -> Subject:
    count = 100

    def measure(share: float, noise: Noise, seed: int) -> Interval:
        truth = np.ones((10, count, 3))
        found = truth.copy()
        found[5:, : round(share * count)] *= 2.0
        still = SteadySweep(places=np.arange(10.0), truth=truth)
        return pop_share(found, still.batches(BATCHES, noise, seed, OWN_NOISE))

    return Subject(
        name="I3 pops",
        case=f"{count} receivers, 10 frames, some twice as bright from the 6th on",
        cause="the share of receivers that pop",
        measure=measure,
        causes=(0.0, 0.01, 0.07, 0.3),
        known=0.07,
        answer=0.07 / 9.0,
        tolerance=ROUNDING,
        broken=_with_nan(pop_share),
        faults={"half of all receivers pop": (0.0, 0.5)},
    )


def _recentring() -> Subject:
    def measure(size: float, noise: Noise, seed: int) -> Interval:
        del noise, seed
        image = np.ones((4, 1, 3))
        moved = image.copy()
        moved[2, 0, 1] += size
        return Measured(value=recentring_difference(image, moved))

    return Subject(
        name="I5 recentring",
        case="four receivers, one of them off by 0.1 after a move",
        cause="the difference",
        measure=measure,
        causes=AMPLITUDES,
        known=AMPLITUDE,
        answer=AMPLITUDE,
        tolerance=ROUNDING,
        broken=lambda: recentring_difference(np.full((2, 1, 3), np.nan), np.ones((2, 1, 3))),
        faults={"a difference of 0.1 over rounding": (1e-6, 0.1)},
        has_interval=False,
    )
