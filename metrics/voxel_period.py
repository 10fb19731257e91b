"""What comes back with every voxel: waves of its length and their share of an unsteady error.

Something moves across voxels in small steps. To the difference between what is rendered and what is
true, waves at the period of a voxel and its harmonics are fitted, together with a smooth trend.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.changes import checked_sweep, energies_of_pairs, light_of, rooted_energy
from metrics.confidence import Estimate, estimate_from_leave_one_out
from metrics.finite import require_finite
from metrics.images import Image
from metrics.measurement import Measurement

PERIOD_RMS_FORMULA = "RMS of the waves at the voxel period in V - R over a smooth trend, / mean R"
PERIOD_SHARE_FORMULA = "energy of these waves / energy of V - R less its trend"

HARMONIC_COUNT = 3
"""Multiples of the voxel's frequency at which what comes back with every voxel is looked for."""

TREND_TERMS = 3
"""A smooth error may drift over the sweep as a parabola does."""

LEAST_PERIODS = 2.0
"""Voxels that a sweep must cross: over a single one, a drift looks like what comes back."""


def voxel_period_rms(
    found: ArrayLike, batches: ArrayLike, places: ArrayLike, *, component: str = "indirect"
) -> Measurement:
    """Root mean square of what comes back with every voxel, over the mean light.

    For each receiver and channel, waves of one voxel's length and its harmonics are fitted to the
    difference from the reference, together with a smooth trend, so that a ripple of known amplitude
    on a drift gives just that. What noise of the frames gives the waves is taken off as well.

    Parameters
    ----------
    found, batches, component
        Frames of fixed receivers, ``(K, N, 3)``, enough for the fit; reference ``(M, K, N, 3)``, M
        >= 3; name of what is compared, for the record.
    places
        ``(K,)`` where whatever moves is in each frame, in voxels of the level in question.

    Returns
    -------
    Measurement
        Below zero means below the noise.

    Raises
    ------
    ValueError
        For illegal input, a reference without light, and for places that do not cross two voxels or
        are too few or too coarse for the waves.
    """
    frames, checked = checked_sweep(found, batches, least=2)
    fit = _WaveFit(_checked_places(places, len(frames)))
    estimate = rooted_energy(
        lambda reference: fit.energies(frames - reference)[0], checked, light_of(checked)
    )
    return _measurement(estimate, "voxel_period_rms", component, PERIOD_RMS_FORMULA)


def voxel_period_share(
    found: ArrayLike, batches: ArrayLike, places: ArrayLike, *, component: str = "indirect"
) -> Measurement:
    """Share of the unsteady error that comes back with every voxel: 1 if all of it does.

    Parameters
    ----------
    found, batches, places, component
        As `voxel_period_rms` takes them.

    Returns
    -------
    Measurement
        0 where the error is steady, or as likely at any other frequency; below zero where it is at
        others, which leave the voxel's less than chance would. Noise of the reference is in
        neither energy; where it is most of what changes, the interval is wide.

    Raises
    ------
    ValueError
        As `voxel_period_rms`.
    """
    frames, checked = checked_sweep(found, batches, least=2)
    fit = _WaveFit(_checked_places(places, len(frames)))

    whole, without_one = energies_of_pairs(
        lambda reference: np.array(fit.energies(frames - reference)), checked
    )
    estimate = estimate_from_leave_one_out(
        _share(whole), np.array([_share(each) for each in without_one])
    )
    return _measurement(estimate, "voxel_period_share", component, PERIOD_SHARE_FORMULA)


def _share(energies: NDArray[np.float64]) -> float:
    """Return waves over all, 0 where there is nothing."""
    waves, whole = energies
    return float(waves / whole) if whole > 0.0 else 0.0


class _WaveFit:
    """Least squares of a trend and the waves of the voxel, to every receiver's course alike."""

    def __init__(self, places: NDArray[np.float64]) -> None:
        turns = 2.0 * np.pi * np.arange(1, HARMONIC_COUNT + 1)[:, None] * places[None, :]
        middle = 0.5 * (places.min() + places.max())
        along = 2.0 * (places - middle) / np.ptp(places)
        trend = np.stack([along**power for power in range(TREND_TERMS)])
        self._basis = np.concatenate([trend, np.cos(turns), np.sin(turns)]).T
        self._free = len(places) - self._basis.shape[1]
        if self._free < 1 or np.linalg.matrix_rank(self._basis, tol=1e-6) < self._basis.shape[1]:
            raise ValueError(
                f"places must tell {HARMONIC_COUNT} harmonics of a voxel from a parabola, got "
                f"{len(places)}: move in steps of an eighth of a voxel or less."
            )
        self._inverse = np.linalg.pinv(self._basis)

    def energies(self, error: Image) -> tuple[float, float]:
        """Return the mean squares of the waves, and of waves and what no wave or trend explains.

        White noise of the frames falls on waves as on anything else; what it gives them is known
        from what is left over, and taken off.
        """
        course = error.reshape(len(error), -1)
        weights = self._inverse @ course
        noise = ((course - self._basis @ weights) ** 2).sum(axis=0) / self._free
        found = 0.5 * (weights[TREND_TERMS:] ** 2).sum(axis=0)
        by_noise = 0.5 * noise * (self._inverse[TREND_TERMS:] ** 2).sum()
        waves = float((found - by_noise).mean())
        return waves, waves + float(noise.mean())


def _checked_places(places: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return the places, once they are known to cross voxels enough."""
    values = np.asarray(places, dtype=np.float64)
    if values.shape != (count,):
        raise ValueError(f"places must be ({count},), one for each frame, got {values.shape}.")
    require_finite(values, "places")
    crossed = np.ptp(values) * count / max(count - 1, 1)
    if crossed < LEAST_PERIODS * (1.0 - 1e-9):
        raise ValueError(
            f"places must cross {LEAST_PERIODS:g} voxels, got {crossed:g}: over less, a "
            "drift cannot be told from what comes back with every voxel."
        )
    return values


def _measurement(estimate: Estimate, name: str, component: str, formula: str) -> Measurement:
    return Measurement.from_estimate(
        estimate, name=name, component=component, formula=formula, ideal=0.0
    )
