"""Specular banding: how much a picture owes to where its marches happened to sample.

Two numbers. B1 needs no reference: it renders with several start phases and looks at the spread.
B2 asks how much of a residual follows the phase of the march across the picture, so that bands
count and noise does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.finite import require_finite

PHASE_SPREAD_FORMULA = "sqrt(mean_px var_phase V) / mean V, var over K phases with K - 1"
STRUCTURED_SHARE_FORMULA = (
    "power of the residual that the march's phase explains, in tiles, over pixels"
)

LEAST_PHASES = 2
"""Fewest phases that have a spread; 8 is a good number."""

HARMONIC_COUNT = 2
"""Multiples of the step frequency that a band may be made of."""

TILE_EDGE = 16
"""Pixels along an edge of the tiles in which bands keep their strength and place."""


def phase_spread(phases: ArrayLike, mask: ArrayLike | None = None) -> float:
    """B1: root mean square over pixels of the spread over start phases, over the mean.

    Parameters
    ----------
    phases
        One picture for each of K start phases, evenly spread over a step, all else equal:
        ``(K, H, W)`` or ``(K, H, W, 3)``, K >= 2. Channels count as pixels.
    mask
        ``(H, W)``, true where a picture counts; None: everywhere.

    Returns
    -------
    float
        0 for pictures that do not depend on the phase.

    Raises
    ------
    ValueError
        For another shape, too few phases, numbers that are not finite, an empty mask, or pictures
        without light: a spread has no scale then.
    """
    pictures = np.asarray(phases, dtype=np.float64)
    if pictures.ndim not in (3, 4) or len(pictures) < LEAST_PHASES or pictures.size == 0:
        raise ValueError(
            f"phases must be (K, H, W) or (K, H, W, 3) with K >= {LEAST_PHASES}, not empty, "
            f"got {pictures.shape}: render the view at several start phases."
        )
    require_finite(pictures, "phases")
    chosen = pictures[:, _checked_mask(mask, pictures.shape[1:3])]
    mean = float(chosen.mean())
    if not mean > 0.0:
        raise ValueError(f"phases must hold light, got a mean of {mean}: mask what is not glossy.")
    return float(np.sqrt(chosen.var(axis=0, ddof=1).mean())) / mean


def structured_power(
    residual: ArrayLike, cycles: ArrayLike, mask: ArrayLike | None = None
) -> float:
    """B2: mean power of a residual that follows the phase of the march.

    In each tile of the picture the residual, less its mean and slope, is projected on the first
    harmonics of the march's phase. Noise falls on them as on any other pattern; the power that it
    would give them is taken off, so noise has expectation zero.

    Parameters
    ----------
    residual
        Relative residual, ``(H, W)``: (V - R) / R, with R the truth, or the mean over start phases.
    cycles
        Steps of the march from its start to what is seen, ``(H, W)``, a real number; a band repeats
        where it grows by one. A tile counts if it sees at least one cycle and at most one for two
        pixels.
    mask
        ``(H, W)``, true where the surface is smooth and the reference has no edge; None:
        everywhere.

    Returns
    -------
    float
        In squared units of the residual; may be below zero by chance, which means no bands.

    Raises
    ------
    ValueError
        For other shapes, numbers that are not finite under the mask, or if no tile counts.
    """
    power, _ = _tiled_powers(residual, cycles, mask)
    return power


def structured_share(
    residual: ArrayLike, cycles: ArrayLike, mask: ArrayLike | None = None
) -> float:
    """`structured_power` over the power of the whole high-passed residual: 1 for bands alone.

    Parameters
    ----------
    residual, cycles, mask
        As `structured_power` takes them.

    Returns
    -------
    float
        0 for a residual without any power.

    Raises
    ------
    ValueError
        As `structured_power`.
    """
    power, total = _tiled_powers(residual, cycles, mask)
    return power / total if total > 0.0 else 0.0


def _tiled_powers(
    residual: ArrayLike, cycles: ArrayLike, mask: ArrayLike | None
) -> tuple[float, float]:
    """Structured and whole power of the high-passed residual, means over pixels of good tiles."""
    values = np.asarray(residual, dtype=np.float64)
    phase = np.asarray(cycles, dtype=np.float64)
    if values.ndim != 2 or values.shape != phase.shape:
        raise ValueError(
            f"residual and cycles must be (H, W) of one shape, got {values.shape} and "
            f"{phase.shape}: pass luminance."
        )
    chosen = _checked_mask(mask, values.shape)
    require_finite(values[chosen], "residual under the mask")
    require_finite(phase[chosen], "cycles under the mask")
    structured, whole, count = 0.0, 0.0, 0
    for top in range(0, values.shape[0], TILE_EDGE):
        for left in range(0, values.shape[1], TILE_EDGE):
            tile = np.s_[top : top + TILE_EDGE, left : left + TILE_EDGE]
            rows, columns = np.nonzero(chosen[tile])
            found = _tile_powers(
                values[tile][rows, columns], phase[tile][rows, columns], rows, columns
            )
            if found is not None:
                structured, whole = structured + found[0], whole + found[1]
                count += len(rows)
    if count == 0:
        raise ValueError(
            f"no tile of {TILE_EDGE} x {TILE_EDGE} pixels has at least one cycle of the march and "
            "enough pixels under the mask: render a larger picture, or widen the mask."
        )
    return structured / count, whole / count


def _tile_powers(
    values: NDArray[np.float64],
    phase: NDArray[np.float64],
    rows: NDArray[np.int_],
    columns: NDArray[np.int_],
) -> tuple[float, float] | None:
    """Structured and whole sum of squares of one tile, or None where bands cannot be told."""
    turns = 2.0 * np.pi * np.arange(1, HARMONIC_COUNT + 1)[:, None] * phase[None, :]
    trend = np.stack([np.ones(len(rows)), rows, columns]).astype(np.float64)
    waves = np.concatenate([np.cos(turns), np.sin(turns)])
    free = len(values) - len(trend) - len(waves)
    if free < len(values) // 2 or np.ptp(phase) < 1.0 or _is_too_fine(phase, rows, columns):
        return None
    detrended = _less_projection(np.concatenate([values[None], waves]), trend)
    rest = _less_projection(detrended[:1], detrended[1:])
    whole, noise = float((detrended[0] ** 2).sum()), float((rest[0] ** 2).sum())
    # Noise gives each wave the same power as each of the other degrees of freedom.
    return whole - noise - len(waves) * noise / free, whole


def _less_projection(
    values: NDArray[np.float64], basis: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return values less what a combination of the basis explains, row by row."""
    weights, *_ = np.linalg.lstsq(basis.T, values.T, rcond=None)
    return values - (basis.T @ weights).T


def _is_too_fine(
    phase: NDArray[np.float64], rows: NDArray[np.int_], columns: NDArray[np.int_]
) -> bool:
    """Whether the phase runs faster than half a cycle a pixel, where pixels cannot show bands."""
    plane, *_ = np.linalg.lstsq(np.stack([rows, columns, np.ones(len(rows))]).T, phase, rcond=None)
    return float(np.hypot(plane[0], plane[1])) > 0.5


def _checked_mask(mask: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the mask, all true where there is none."""
    if mask is None:
        return np.ones(shape, dtype=np.bool_)
    chosen = np.asarray(mask)
    if chosen.dtype != np.bool_ or chosen.shape != shape:
        raise ValueError(f"mask must be boolean and {shape}, got {chosen.dtype} {chosen.shape}.")
    if not chosen.any():
        raise ValueError("mask must be true somewhere, got all false: nothing is left to measure.")
    return chosen
