"""Flicker of known size: light that blinks, and noise that differs from seed to seed."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np

from experiments.studies.validation.subject import Interval, Subject
from metrics.flicker import Motion, flicker, flicker_rms
from metrics.flicker_parts import flicker_noise, flicker_structure
from metrics.measurement import Measurement
from metrics.synthetic import Noise, sliding_motion

SHAPE = (4, 12, 16, 3)
"""Frames, rows, columns, channels."""

BATCHES, SEEDS = 6, 4
"""Batches of the reference, and renderings with seeds of their own."""

AMPLITUDE = 0.1
"""Of the known flicker, over the mean light."""

AMPLITUDES = (0.0, 0.02, 0.05, 0.1, 0.2)

ROUNDING = 1e-9

WALL = "flat wall of 16 x 12 pixels, the eye slides by 0.4 pixels"

Measure = Callable[..., Measurement]


def subjects() -> list[Subject]:
    """Return the metrics of flicker."""
    return [*_whole(), _structure(), _noise()]


@cache
def _motion() -> Motion:
    frames, height, width, _ = SHAPE
    return sliding_motion(frames=frames, height=height, width=width)[0]


def _blinking(factor: float) -> np.ndarray:
    """Return frames of which every other one is brighter: each change is that much of the light."""
    found = np.ones(SHAPE)
    found[1::2] += factor
    return found


def _batches(noise: Noise, seed: int) -> np.ndarray:
    return noise(np.random.default_rng(seed), (BATCHES, *SHAPE))


def _whole() -> list[Subject]:
    def measure(factor: float, noise: Noise, seed: int, *, metric: Measure) -> Interval:
        return metric(_blinking(factor), _batches(noise, seed), _motion())

    def one_nan(metric: Measure) -> object:
        found = np.ones(SHAPE)
        found[1, 2, 3, 0] = np.nan
        return metric(found, np.ones((BATCHES, *SHAPE)), _motion())

    return [
        Subject(
            name=name,
            case=f"{WALL}; every other frame brighter, {BATCHES} batches",
            cause="how much brighter",
            measure=partial(measure, metric=metric),
            causes=AMPLITUDES,
            known=AMPLITUDE,
            answer=AMPLITUDE,
            tolerance=ROUNDING,
            broken=partial(one_nan, metric),
            faults={f"energy times {1.0 + fault:g} every other frame": (0.0, fault)},
        )
        # A distance does not tell from noise what is less than the noise.
        for name, metric, fault in (
            ("flicker, mean", flicker, 0.5),
            ("flicker, RMS", flicker_rms, 0.05),
        )
    ]


def _with_nan(metric: Measure) -> object:
    found = np.ones((SEEDS, *SHAPE))
    found[2, 1, 2, 3, 0] = np.nan
    return metric(found, np.ones((BATCHES, *SHAPE)), _motion())


def _structure() -> Subject:
    def measure(factor: float, noise: Noise, seed: int) -> Interval:
        # Renderings are as noisy as batches, with seeds of their own.
        renderings = _blinking(factor) * noise(np.random.default_rng([seed, 1]), (SEEDS, *SHAPE))
        return flicker_structure(renderings, _batches(noise, seed), _motion())

    return Subject(
        name="flicker, structure",
        case=f"{WALL}; every other frame brighter, {SEEDS} noisy renderings, {BATCHES} batches",
        cause="how much brighter",
        measure=measure,
        causes=AMPLITUDES,
        known=AMPLITUDE,
        answer=AMPLITUDE,
        tolerance=ROUNDING,
        broken=partial(_with_nan, flicker_structure),
        faults={"energy times 1.2 every other frame": (0.0, 0.2)},
    )


def _noise() -> Subject:
    def measure(spread: float, noise: Noise, seed: int) -> Interval:
        # Half of the renderings blink up where the others blink down, so no mean of them blinks.
        signs = np.where(np.arange(SEEDS) % 2 == 0, 1.0, -1.0)
        renderings = np.stack([_blinking(spread * sign) for sign in signs])
        return flicker_noise(renderings, _batches(noise, seed), _motion())

    return Subject(
        name="flicker, noise",
        case=f"{WALL}; of {SEEDS} renderings half blink up, half down, {BATCHES} batches",
        cause="how far",
        measure=measure,
        causes=AMPLITUDES,
        known=AMPLITUDE,
        # The variance of +-a among S is a^2 S / (S - 1).
        answer=AMPLITUDE * math.sqrt(SEEDS / (SEEDS - 1.0)),
        tolerance=ROUNDING,
        broken=partial(_with_nan, flicker_noise),
        faults={"a spread of 0.2": (0.0, 0.2)},
    )
