"""Errors of pictures, expected over seeds: relMSE and energy of indirect light, FLIP of the whole.

Nothing here renders, so that other processes can do it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from os import cpu_count
from typing import Final

import numpy as np

from experiments.studies.check import Measured, mean_of
from metrics.display import DisplaySettings, display_settings
from metrics.energy import energy_ratio
from metrics.measurement import Measurement
from metrics.perceptual import flip
from metrics.squared_error import relmse_e2

GROUPS: Final = 6
"""Of a reference's batches: few enough that all pairs of them are quickly gone through."""

SMALL_PICTURE: Final = 128 * 128
"""Pixels up to which FLIP sees three pictures of a method; larger ones vary little by seed."""

MANY_CORES: Final = 4
"""From which on pictures are compared in processes of their own."""


@dataclass(frozen=True)
class Truth:
    """What pictures are compared with.

    Attributes
    ----------
    indirect
        Groups of batches [group, row, column, rgb].
    shared
        Direct light and emission, which all methods show alike [row, column, rgb].
    display
        How the whole picture is shown.
    flip_noise
        FLIP between two halves of the reference: how far its noise may have raised any FLIP.
    """

    indirect: np.ndarray
    shared: np.ndarray
    display: DisplaySettings
    flip_noise: float

    @classmethod
    def of(cls, indirect: np.ndarray, shared: np.ndarray) -> Truth:
        """Group batches [batch, row, column, rgb]."""
        parts = np.array_split(indirect.astype(np.float64), min(GROUPS, len(indirect)))
        groups = np.stack([part.mean(axis=0) for part in parts])
        display = display_settings(groups.mean(axis=0) + shared)
        middle = len(groups) // 2
        first, second = (each.mean(axis=0) + shared for each in (groups[:middle], groups[middle:]))
        return cls(groups, shared, display, flip(first, second, display.flip).mean)


@dataclass(frozen=True)
class Score:
    """Expected errors of a method's pictures, with 95 % intervals."""

    relmse: Measured
    energy: Measured
    flip: Measured


def score(pictures: Sequence[np.ndarray], truth: Truth) -> Score:
    """Compare pictures of one method, each of its own seed, with the truth.

    Parameters
    ----------
    pictures
        Indirect light [row, column, rgb]; at least one.
    truth
        What it should be.
    """
    means = truth.indirect.mean(axis=0) + truth.shared
    is_small = pictures[0].shape[0] * pictures[0].shape[1] <= SMALL_PICTURE
    flips = [
        flip(each + truth.shared, means, truth.display.flip).mean
        for each in pictures[: 3 if is_small else 1]
    ]
    return Score(
        relmse=_expected([relmse_e2(each, truth.indirect) for each in pictures]),
        energy=_expected([energy_ratio(each, truth.indirect) for each in pictures]),
        flip=_noise_adds(mean_of(flips), truth.flip_noise),
    )


def score_all(pictures: dict[str, list[np.ndarray]], truth: Truth) -> dict[str, Score]:
    """Score all methods, in several processes where there are many cores and large pictures."""
    one = partial(score, truth=truth)
    workers = min((cpu_count() or 1) - 1, 12)
    first = next(iter(pictures.values()))[0]
    if workers < MANY_CORES or first.size < SMALL_PICTURE:
        found = [one(each) for each in pictures.values()]
    else:
        # Processes that inherit nothing: a device's state must not be copied.
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            found = list(pool.map(one, pictures.values()))
    return dict(zip(pictures, found, strict=True))


def _expected(found: Sequence[Measurement]) -> Measured:
    """Return the mean over seeds; its interval holds their spread and the reference's noise."""
    reference_halves = [
        max(each.high - each.value, each.value - each.low)
        for each in found
        if each.low is not None and each.high is not None
    ]
    assert len(reference_halves) == len(found), "errors against so many batches have intervals"
    return _widened(mean_of([each.value for each in found]), float(np.mean(reference_halves)))


def _widened(found: Measured, half: float) -> Measured:
    """Return a mean whose interval allows for another, independent error, too."""
    own = 0.0 if found.low is None or found.high is None else 0.5 * (found.high - found.low)
    whole = math.hypot(own, half)
    return Measured(value=found.value, low=found.value - whole, high=found.value + whole)


def _noise_adds(found: Measured, noise: float) -> Measured:
    """Return a mean distance whose lower end allows for noise, which only ever adds to it."""
    low = found.value if found.low is None else found.low
    high = found.value if found.high is None else found.high
    return Measured(value=found.value, low=low - noise, high=high)
