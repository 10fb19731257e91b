"""Attribution: renderers whose stages are wrong by known factors."""

from __future__ import annotations

from functools import partial

import numpy as np

from experiments.studies.check import Measured
from experiments.studies.validation.subject import Interval, Subject
from metrics.attribution import EPSILON_SHARE, ErrorKind, attribute_error
from metrics.energy import energy_ratio
from metrics.synthetic import Noise

BATCHES = 5
SHAPE = (8, 10)
NAMES = ("first", "second")
FACTORS = (0.0, 0.02, 0.05, 0.1, 0.2)
KNOWN = 0.1
ROUNDING = 1e-9

CASE = f"two stages, {SHAPE[1]} x {SHAPE[0]} pixels, {BATCHES} batches, noise of each picture"


def subjects() -> list[Subject]:
    """Return the rows of attribution, and of the energy that closes it."""
    return [*_owned(), _left(), _energy()]


def level() -> np.ndarray:
    """Return the true light [1, row, column, 1]."""
    return np.linspace(0.5, 2.0, SHAPE[0] * SHAPE[1]).reshape(1, *SHAPE, 1)


def _picture(noise: Noise, seed: int) -> np.ndarray:
    return level() * noise(np.random.default_rng(seed), (BATCHES, *SHAPE, 3))


def _owned() -> list[Subject]:
    def measure(excess: float, noise: Noise, seed: int, *, kind: ErrorKind) -> Interval:
        """Measure what the first stage owns, which alone is too bright."""
        start, half, exact, reference = (_picture(noise, 10 * seed + k) for k in range(4))
        start = (1.0 + excess) * start
        found = attribute_error(
            kind, NAMES, [start, half, exact], [start, (1.0 + excess) * half, exact], reference
        )
        return found.stages[0].forward

    light = level()
    scale = light**2 + EPSILON_SHARE * light.mean() ** 2
    answers: dict[ErrorKind, float] = {
        "energy": KNOWN,
        "relmse": float(np.mean((KNOWN * light) ** 2 / scale)),
    }
    return [
        Subject(
            name=f"attribution, {kind} of a stage",
            case=CASE,
            cause="the stage's factor",
            measure=partial(measure, kind=kind),
            causes=FACTORS,
            known=KNOWN,
            answer=answer,
            tolerance=ROUNDING,
            broken=partial(_broken, kind),
            faults={"a stage times 1.5": (0.0, 0.5)},
        )
        for kind, answer in answers.items()
    ]


def _broken(kind: ErrorKind) -> object:
    chain = [np.full((BATCHES, *SHAPE, 3), np.nan)] * 3
    return attribute_error(kind, NAMES, chain, chain, np.ones((BATCHES, *SHAPE, 3)))


def _left() -> Subject:
    def measure(excess: float, noise: Noise, seed: int) -> Interval:
        """Measure what is left over when all stages are exact, but for a factor."""
        start, half, exact, reference = (_picture(noise, 10 * seed + k) for k in range(4))
        exact = (1.0 + excess) * exact
        found = attribute_error(
            "energy", NAMES, [start, half, exact], [start, half, exact], reference
        )
        return found.end

    return Subject(
        name="attribution, energy left over",
        case=CASE,
        cause="the factor that no stage owns",
        measure=measure,
        causes=FACTORS,
        known=KNOWN,
        answer=KNOWN,
        tolerance=ROUNDING,
        broken=partial(_broken, "energy"),
        faults={"energy times 1.05": (0.0, 0.05)},
    )


def _energy() -> Subject:
    def measure(excess: float, noise: Noise, seed: int) -> Interval:
        """Measure the excess of energy, so that the reference has none."""
        picture = np.broadcast_to((1.0 + excess) * level()[0], (*SHAPE, 3))
        found = energy_ratio(picture, _picture(noise, seed))
        assert found.low is not None
        assert found.high is not None
        return Measured(value=found.value - 1.0, low=found.low - 1.0, high=found.high - 1.0)

    return Subject(
        name="energy ratio less one",
        case=f"{SHAPE[1]} x {SHAPE[0]} pixels, {BATCHES} batches",
        cause="the factor",
        measure=measure,
        causes=FACTORS,
        known=KNOWN,
        answer=KNOWN,
        tolerance=ROUNDING,
        broken=lambda: energy_ratio(np.full((4, 4, 3), np.nan), np.ones((2, 4, 4, 3))),
        faults={"energy times 1.05": (0.0, 0.05)},
    )
