"""Injection aliasing: what indirect light does as something moves that the true light does not.

A light, an object, a camera or the lattice itself moves in small steps. I1 is the ripple of the
power in the voxels, before any cone is traced. I2 is the change from frame to frame that the truth
does not have, I3 the share of receivers where it is a jump; I5 asks that a move by whole voxels
change nothing. What comes back with every voxel is told from the rest in `voxel_period`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.changes import checked_sweep, light_of, mean_change_error, rms_change_error
from metrics.confidence import Estimate, estimate_from_leave_one_out
from metrics.finite import require_finite
from metrics.images import checked_image
from metrics.luminance import luminance
from metrics.measurement import Measurement

POWER_RIPPLE_FORMULA = "(max - min) / mean over places, of power over expected power"
DIFFERENCE_FORMULA = "mean |dV - dR| / mean R, d from frame to frame"
DIFFERENCE_RMS_FORMULA = "sqrt(mean (dV - dR)^2) / mean R, d from frame to frame"
POP_FORMULA = "share of receivers and steps with |dV - dR| > 4 MAD(dR) + 0.01 mean R, luminance"

POP_DEVIATIONS = 4.0
POP_VISIBLE = 0.01
"""A pop is a change beyond so many median absolute deviations of the true change, and beyond so
much of the mean light, without which it would be invisible."""


def power_ripple(
    powers: ArrayLike, expected: ArrayLike | None = None, *, component: str = "emittance"
) -> Measurement:
    """I1: range of the power in the voxels over all places, over its mean.

    Parameters
    ----------
    powers
        Power at each of K places, ``(K,)``, K >= 2; or ``(M, K)`` for M independent repetitions, M
        >= 2, which give it an interval. Noise widens a range; the low end allows for that.
    expected
        ``(K,)`` power that the places should have, if that is not the same for all.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For another shape, numbers that are not finite, or a mean that is not above zero.
    """
    values = _checked_powers(powers, expected)
    scaled = np.atleast_2d(values) / float(values.mean())
    value, low, high = float(np.ptp(scaled.mean(axis=0))), None, None
    if len(scaled) > 1:
        total, count = scaled.sum(axis=0), len(scaled)
        without_one = np.array([np.ptp((total - one) / (count - 1)) for one in scaled])
        halves = scaled[: count // 2].mean(axis=0) - scaled[count // 2 :].mean(axis=0)
        estimate = estimate_from_leave_one_out(
            value, without_one, noise_floor=float(np.ptp(halves))
        )
        value, low, high = estimate.value, estimate.low, estimate.high
    return Measurement(
        name="power_ripple",
        component=component,
        value=value,
        low=low,
        high=high,
        formula=POWER_RIPPLE_FORMULA,
        unit="",
        ideal=0.0,
    )


def temporal_difference_error(
    found: ArrayLike, batches: ArrayLike, *, component: str = "indirect"
) -> Measurement:
    """I2: mean absolute change from frame to frame beyond that of the truth.

    A distance, which takes noise for error: see `jackknife_of_distance` for its interval.

    Parameters
    ----------
    found
        Frames of fixed receivers, ``(K, N, 3)``, K >= 2.
    batches
        Reference, ``(M, K, N, 3)``, M >= 2.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input or a reference without light.
    """
    frames, checked = checked_sweep(found, batches, least=2)
    estimate = mean_change_error(
        np.diff(frames, axis=0), np.diff(checked, axis=1), light_of(checked)
    )
    return _measurement(estimate, "temporal_difference_error", component, DIFFERENCE_FORMULA)


def temporal_difference_rms(
    found: ArrayLike, batches: ArrayLike, *, component: str = "indirect"
) -> Measurement:
    """I2 as a root mean square, from which the noise of the reference is taken out exactly.

    Parameters
    ----------
    found, batches, component
        As `temporal_difference_error` takes them.

    Raises
    ------
    ValueError
        As `temporal_difference_error`.
    """
    frames, checked = checked_sweep(found, batches, least=2)
    estimate = rms_change_error(
        np.diff(frames, axis=0), np.diff(checked, axis=1), light_of(checked)
    )
    return _measurement(estimate, "temporal_difference_rms", component, DIFFERENCE_RMS_FORMULA)


def pop_share(found: ArrayLike, batches: ArrayLike, *, component: str = "indirect") -> Measurement:
    """I3: share of receivers and steps in which the light jumps and the truth does not.

    The threshold is that of the mean of all batches, luminance throughout. What the halves of the
    reference do to each other counts as noise, for which the low end allows.

    Parameters
    ----------
    found, batches, component
        As `temporal_difference_error` takes them.

    Raises
    ------
    ValueError
        As `temporal_difference_error`.
    """
    frames, checked = checked_sweep(found, batches, least=2)
    change = np.diff(luminance(frames), axis=0)
    changes = np.diff(np.stack([luminance(batch) for batch in checked]), axis=1)
    true_change = changes.mean(axis=0)
    deviation = float(np.median(np.abs(true_change - np.median(true_change))))
    scale = float(luminance(checked.mean(axis=0)).mean())
    threshold = POP_DEVIATIONS * deviation + POP_VISIBLE * scale

    def share(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
        return float((np.abs(first - second) > threshold).mean())

    total, count = changes.sum(axis=0), len(changes)
    halves = [half.mean(axis=0) for half in (changes[: count // 2], changes[count // 2 :])]
    estimate = estimate_from_leave_one_out(
        share(change, true_change),
        np.array([share(change, (total - one) / (count - 1)) for one in changes]),
        noise_floor=share(*halves),
    )
    return _measurement(estimate, "pop_share", component, POP_FORMULA)


def recentring_difference(first: ArrayLike, moved: ArrayLike) -> float:
    """I5: largest difference after a move by whole voxels of scene, camera and windows together.

    Parameters
    ----------
    first, moved
        The same receivers before and after, ``(N, 1, 3)`` or any image.

    Returns
    -------
    float
        Over the mean of the first; 0 up to rounding for windows that are centred exactly.

    Raises
    ------
    ValueError
        For illegal images, two shapes, or a first one without light.
    """
    before, after = checked_image(first, "first"), checked_image(moved, "moved")
    if before.shape != after.shape:
        raise ValueError(
            f"first and moved must have one shape, got {before.shape} and {after.shape}."
        )
    mean = float(before.mean())
    if not mean > 0.0:
        raise ValueError(f"first must hold light, got a mean of {mean}.")
    return float(np.abs(after - before).max()) / mean


def _checked_powers(powers: ArrayLike, expected: ArrayLike | None) -> NDArray[np.float64]:
    """Return powers over what is expected, once both are known to be legal."""
    values = np.asarray(powers, dtype=np.float64)
    if values.ndim not in (1, 2) or values.shape[-1] < 2 or (values.ndim == 2 and len(values) < 2):
        raise ValueError(
            f"powers must be (K,) or (M, K) with K >= 2 and M >= 2, got {values.shape}: measure "
            "the power at several places."
        )
    require_finite(values, "powers")
    if expected is not None:
        goal = np.asarray(expected, dtype=np.float64)
        require_finite(goal, "expected")
        if goal.shape != values.shape[-1:] or not (goal > 0.0).all():
            raise ValueError(
                f"expected must be ({values.shape[-1]},) and above zero, got {goal.shape} from "
                f"{goal.min(initial=np.inf)}."
            )
        values = values / goal
    if not values.mean() > 0.0:
        raise ValueError(f"powers must have a mean above zero, got {values.mean()}: all is dark.")
    return values


def _measurement(estimate: Estimate, name: str, component: str, formula: str) -> Measurement:
    return Measurement.from_estimate(
        estimate, name=name, component=component, formula=formula, ideal=0.0
    )
