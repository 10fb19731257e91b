"""What the measures over time share: sweeps of frames, and changes beyond those of the truth.

A sweep is K frames of N receivers, ``(K, N, 3)``, and its reference is ``(M, K, N, 3)``: M batches,
each a whole sweep with a seed of its own. Frames of one batch may share their random numbers, which
takes most noise out of differences between them; only the batches have to be independent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import copysign, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.confidence import Estimate, estimate_from_leave_one_out
from metrics.images import Batches, Image, checked_inputs

Energies = NDArray[np.float64]
"""Numbers that are quadratic in the light, ``(Q,)``."""

LEAST_BATCHES = 3
"""Fewest batches of which one can be left out and still leave a pair."""


def light_of(batches: Batches) -> NDArray[np.float64]:
    """Return the mean light of each batch, ``(M,)``."""
    return np.asarray(batches.reshape(len(batches), -1).mean(axis=1))


def checked_sweep(found: ArrayLike, batches: ArrayLike, *, least: int) -> tuple[Image, Batches]:
    """Return frames and reference in float64, once they fit together and there are enough.

    Parameters
    ----------
    found
        ``(K, N, 3)``.
    batches
        ``(M, K, N, 3)``, M >= 2.
    least
        Fewest frames.

    Raises
    ------
    ValueError
        For illegal input, too few frames, or a reference without light.
    """
    frames, checked = checked_inputs(found, batches)
    if len(frames) < least:
        raise ValueError(
            f"a sweep must hold at least {least} frames for this measure, got {len(frames)}: "
            "move in more steps."
        )
    if not checked.mean() > 0.0:
        raise ValueError(
            f"batches must hold light, got a mean of {checked.mean()}: a change relative to it has "
            "no value."
        )
    return frames, checked


def mean_change_error(change: Image, true_changes: Batches, light: ArrayLike) -> Estimate:
    """Mean absolute difference of changes over the mean light.

    A distance, which takes noise for error: see `jackknife_of_distance` for its interval.

    Parameters
    ----------
    change
        ``(K, N, 3)``.
    true_changes
        ``(M, K, N, 3)``, M >= 2.
    light
        ``(M,)`` mean light of each batch, of a mean above zero. Its noise belongs to the interval.
    """
    count, scale = len(true_changes), _Means(light)
    total = true_changes.sum(axis=0)

    def distance(first: Image, second: Image) -> float:
        return float(np.abs(first - second).mean())

    without_one = [
        distance(change, (total - each) / (count - 1)) / scale.without(number)
        for number, each in enumerate(true_changes)
    ]
    halves = [
        each.mean(axis=0) for each in (true_changes[: count // 2], true_changes[count // 2 :])
    ]
    return estimate_from_leave_one_out(
        distance(change, total / count) / scale.whole,
        np.array(without_one),
        noise_floor=distance(*halves) / scale.whole,
    )


def rms_change_error(change: Image, true_changes: Batches, light: ArrayLike) -> Estimate:
    """Root mean square difference of changes over the mean light, without the reference's noise.

    Parameters
    ----------
    change, true_changes, light
        As `mean_change_error` takes them.
    """
    return rooted_energy(
        lambda true_change: float(((change - true_change) ** 2).mean()), true_changes, light
    )


def rooted_energy(
    energy: Callable[[Image], float], batches: Batches, light: ArrayLike, level: float = 0.95
) -> Estimate:
    """Root of a mean square over the mean light, with the noise of the reference taken out of it.

    Parameters
    ----------
    energy
        Quadratic form of a sweep ``(K, N, 3)``.
    batches
        ``(M, K, N, 3)``, M >= 3.
    light
        As `mean_change_error` takes it.
    level
        Probability that the interval holds the true value.

    Returns
    -------
    Estimate
        ``sign(E) sqrt(abs(E))`` for the energy over squared light and both ends of its interval:
        below zero means below the noise of the reference.

    Raises
    ------
    ValueError
        For fewer than 3 batches, which leave no pair when one is left out.
    """
    whole, without_one = energies_of_pairs(lambda batch: np.array([energy(batch)]), batches)
    return root_of_energies(float(whole[0]), [float(each[0]) for each in without_one], light, level)


def root_of_energies(
    whole: float, without_one: Sequence[float], light: ArrayLike, level: float = 0.95
) -> Estimate:
    """Root of a mean square over the mean light, from the same without each batch.

    Parameters
    ----------
    whole, without_one
        The mean square, and what it is without each of the batches.
    light, level
        As `rooted_energy` takes them.
    """
    scale = _Means(light)
    found = estimate_from_leave_one_out(
        whole / scale.whole**2,
        np.array([each / scale.without(k) ** 2 for k, each in enumerate(without_one)]),
        level,
    )
    return Estimate(
        value=_signed_root(found.value),
        low=_signed_root(found.low),
        high=_signed_root(found.high),
        level=level,
    )


def energies_of_pairs(
    energies: Callable[[Image], Energies], batches: Batches
) -> tuple[Energies, list[Energies]]:
    """Return quadratic forms without the noise of the reference, of all batches and without each.

    They are taken of pairs of different batches only, whose noise is independent, so they have no
    bias, and nothing more needs to be known of the noise.

    Parameters
    ----------
    energies
        Quadratic forms ``(Q,)`` of a sweep ``(K, N, 3)``.
    batches
        ``(M, K, N, 3)``, M >= 3.

    Raises
    ------
    ValueError
        For fewer than 3 batches, which leave no pair when one is left out.
    """
    count = len(batches)
    if count < LEAST_BATCHES:
        raise ValueError(
            f"batches must hold at least {LEAST_BATCHES} independent references, got {count}: "
            "render the reference in more batches, each with its own seed."
        )
    total = batches.sum(axis=0)
    own = np.stack([energies(batch) for batch in batches])

    def of_pairs(mean: Image, own_energies: Energies, number: int) -> Energies:
        found: Energies = (number**2 * energies(mean) - own_energies) / (number * (number - 1))
        return found

    without_one = [
        of_pairs((total - batch) / (count - 1), own.sum(axis=0) - each, count - 1)
        for batch, each in zip(batches, own, strict=True)
    ]
    return of_pairs(total / count, own.sum(axis=0), count), without_one


class _Means:
    """Mean of all batches, and without one of them."""

    def __init__(self, each: ArrayLike) -> None:
        self._each = np.asarray(each, dtype=np.float64)
        self.whole = float(self._each.mean())

    def without(self, number: int) -> float:
        return float(np.delete(self._each, number).mean())


def _signed_root(value: float) -> float:
    return copysign(sqrt(abs(value)), value)
