"""What the measures over time share: sweeps of frames, and changes beyond those of the truth.

A sweep is K frames of N receivers, ``(K, N, 3)``, and its reference is ``(M, K, N, 3)``: M batches,
each a whole sweep with a seed of its own. Frames of one batch may share their random numbers, which
takes most noise out of differences between them; only the batches have to be independent.
"""

from __future__ import annotations

from collections.abc import Callable
from math import copysign, sqrt

import numpy as np
from numpy.typing import ArrayLike

from metrics.confidence import Estimate, estimate_from_leave_one_out, jackknife_of_distance
from metrics.images import Batches, Image, checked_inputs

LEAST_BATCHES = 3
"""Fewest batches of which one can be left out and still leave a pair."""


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


def mean_change_error(change: Image, true_changes: Batches, scale: float) -> Estimate:
    """Mean absolute difference of changes over a scale.

    A distance, which takes noise for error: see `jackknife_of_distance` for its interval.

    Parameters
    ----------
    change
        ``(K, N, 3)``.
    true_changes
        ``(M, K, N, 3)``, M >= 2.
    scale
        Mean light, > 0.
    """
    return jackknife_of_distance(
        lambda first, second: float(np.abs(first - second).mean()) / scale,
        lambda changes: changes,
        change,
        true_changes,
    )


def rms_change_error(change: Image, true_changes: Batches, scale: float) -> Estimate:
    """Root mean square difference of changes over a scale, without the noise of the reference.

    Parameters
    ----------
    change, true_changes, scale
        As `mean_change_error` takes them.
    """
    return rooted_energy(
        lambda true_change: float(((change - true_change) ** 2).mean()), true_changes, scale
    )


def rooted_energy(
    energy: Callable[[Image], float], batches: Batches, scale: float, level: float = 0.95
) -> Estimate:
    """Root of a mean square over a scale, with the noise of the reference taken out of it.

    The quadratic form is taken of pairs of different batches only, whose noise is independent, so
    it has no bias, and nothing more needs to be known of the noise.

    Parameters
    ----------
    energy
        Quadratic form of a sweep ``(K, N, 3)``.
    batches
        ``(M, K, N, 3)``, M >= 3.
    scale
        What the root is divided by, > 0.
    level
        Probability that the interval holds the true value.

    Returns
    -------
    Estimate
        ``sign(E) sqrt(abs(E)) / scale`` for the energy and both ends of its interval: below zero
        means below the noise of the reference.

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
    own = np.array([energy(batch) for batch in batches])

    def of_pairs(mean: Image, own_energies: float, number: int) -> float:
        return (number**2 * energy(mean) - own_energies) / (number * (number - 1))

    without_one = [
        of_pairs((total - batch) / (count - 1), own.sum() - each, count - 1)
        for batch, each in zip(batches, own, strict=True)
    ]
    whole = of_pairs(total / count, own.sum(), count)
    found = estimate_from_leave_one_out(whole, np.array(without_one), level)

    def root(value: float) -> float:
        return copysign(sqrt(abs(value)), value) / scale

    return Estimate(
        value=root(found.value), low=root(found.low), high=root(found.high), level=level
    )
