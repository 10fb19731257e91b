"""Bands of known strength and frequency: sums of a bump in steps, and cosines in a residual."""

from __future__ import annotations

import math

import numpy as np

from experiments.studies.check import Measured
from experiments.studies.validation.subject import Interval, Subject
from metrics.banding import TILE_EDGE, phase_spread, structured_power
from metrics.moving_bands import moving_bands
from metrics.synthetic import Noise, march_cycles, march_ripple, marched_pictures

EDGE = 64
PHASES = np.arange(8) / 8.0
BUMP = 0.4
"""Width of the bump that marches sum, in units of length."""

STEPS = (0.5, 1.0, 1.5, 2.0)
"""Of the march, in the same units."""

KNOWN_STEP = 1.5
PER_UNIT = 0.2
"""Units of length from pixel to pixel."""

HARMONICS = 2
"""Of the phase that the metric counts."""

SPREAD_TOLERANCE, POWER_TOLERANCE = 1e-6, 2e-2
"""Of a variance over phases; of a power in tiles, whose own mean holds parts of a cycle."""

MARCH = f"{EDGE} x {EDGE} pixels; a Gaussian bump of width {BUMP:g} summed in steps"
STEP_TIMES_4 = {"step times 4": (0.5, 2.0)}


def subjects() -> list[Subject]:
    """Return the metrics of bands."""
    return [_spread(), _residual(), _moving()]


def _pictures(step: float) -> tuple[np.ndarray, np.ndarray]:
    cycles = march_cycles(EDGE, PER_UNIT / step)
    return marched_pictures(cycles, PHASES, BUMP / step), cycles


def _band_power(step: float) -> float:
    powers = [0.5 * march_ripple(BUMP / step, m) ** 2 for m in range(1, HARMONICS + 1)]
    return math.fsum(powers)


def _spread() -> Subject:
    def measure(step: float, noise: Noise, seed: int) -> Interval:
        del noise, seed
        return Measured(value=phase_spread(_pictures(step)[0]))

    count = len(PHASES)
    every = math.fsum(0.5 * march_ripple(BUMP / KNOWN_STEP, m) ** 2 for m in range(1, 4))
    return Subject(
        name="B1 phase spread",
        case=f"{MARCH}, {count} phases",
        cause="the step",
        measure=measure,
        causes=STEPS,
        known=KNOWN_STEP,
        answer=math.sqrt(every * count / (count - 1)),
        tolerance=SPREAD_TOLERANCE,
        zero=0.25,
        broken=lambda: phase_spread(np.full((2, 4, 4), np.nan)),
        faults=STEP_TIMES_4,
        has_interval=False,
    )


def _residual() -> Subject:
    """Three cycles to a tile, even about its middle: neither a mean nor a slope is taken off."""
    middle = 0.5 * (TILE_EDGE - 1)
    column = np.mgrid[0:EDGE, 0:EDGE][1] % TILE_EDGE - middle
    cycles = 3.0 / TILE_EDGE * column

    def measure(strength: float, noise: Noise, seed: int) -> Interval:
        bands = strength * np.cos(2.0 * np.pi * cycles)
        other = noise(np.random.default_rng(seed), bands.shape) - 1.0
        return Measured(value=structured_power(bands + other, cycles))

    return Subject(
        name="B2 structured residual",
        case=f"{EDGE} x {EDGE} pixels; a cosine of 3 cycles to a tile",
        cause="the strength",
        measure=measure,
        causes=(0.0, 0.05, 0.1, 0.2),
        known=0.1,
        answer=0.5 * 0.1**2,
        tolerance=1e-9,
        broken=lambda: structured_power(np.full((EDGE, EDGE), np.nan), cycles),
        faults={"bands of 0.2 in noise of 10 %, over bands of 0.1": (0.1, 0.2)},
        has_interval=False,
    )


def _moving() -> Subject:
    def measure(step: float, noise: Noise, seed: int) -> Interval:
        pictures, cycles = _pictures(step)
        noisy = pictures * noise(np.random.default_rng(seed), pictures.shape)
        return moving_bands(noisy, PHASES, cycles).power

    return Subject(
        name="moving bands (B1 and B2 without a reference)",
        case=f"{MARCH}, {len(PHASES)} phases; noise in each picture",
        cause="the step",
        measure=measure,
        causes=STEPS,
        known=KNOWN_STEP,
        answer=_band_power(KNOWN_STEP),
        tolerance=POWER_TOLERANCE,
        zero=0.5,
        broken=lambda: moving_bands(
            np.full((8, EDGE, EDGE), np.nan), PHASES, march_cycles(EDGE, PER_UNIT)
        ),
        faults=STEP_TIMES_4,
    )
