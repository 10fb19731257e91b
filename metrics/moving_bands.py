"""Bands that belong to the march: what moves across the picture when all marches start elsewhere.

A residual against the truth holds every error of the method, and some of those lie along the same
waves as the bands: voxels stand on a lattice, and steps are as long as voxels. But only what the
march's steps cause moves when the start phase does, and it moves in one way: light that depends on
where samples fall depends on ``cycles + phase``, the number of steps to what is seen plus the share
of a step by which all starts are shifted. So pictures at several phases are demodulated. In each
pixel the part of frequency m in the phase is taken, which leaves out all that stands still: the
truth, the reference's noise, and every error that the march has no part in. Then it is turned back
by m times the pixel's cycles, and multiplied with that of its neighbours. Neighbours agree on a
band, so its power comes out; noise, of which each pixel has another, does not agree with itself.
Only neighbours, because the number of steps to what is seen is never known so exactly that all of a
tile would agree: a wall is as thick as a voxel to a cone, and what is seen of it depends on where
in the lattice of the voxels it lies.

The method is that of a lock-in amplifier.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.banding import HARMONIC_COUNT, TILE_EDGE
from metrics.confidence import Estimate, estimate_from_leave_one_out
from metrics.finite import require_finite

FORMULA = "power of V over start phases that follows cycles + phase, in tiles, over (mean V)^2"

NEIGHBOUR_REACH = 2
"""How far apart, in rows and in columns, pixels are that should agree on a band."""

LEAST_PIXELS = TILE_EDGE * TILE_EDGE // 2
"""Pixels under the mask that a tile must hold."""

LEAST_CYCLES = 1.0
"""Cycles that a tile must see, or what moves is no band but the brightness of all of it."""

MOST_CYCLES_PER_PIXEL = 0.5
"""Frequency of the finest bands that pixels can show."""


@dataclass(frozen=True, kw_only=True)
class MovingBands:
    """Bands of a picture, relative to its mean light; each estimate's interval is over tiles.

    Attributes
    ----------
    power
        Of bands: mean square over pixels, start phases and tiles; may be below zero by chance,
        which means none.
    spread
        Of all that moves with the phase, as a mean square: bands and noise.
    tile_powers, tile_spreads
        Both of each tile that counts.
    """

    power: Estimate
    spread: Estimate
    tile_powers: NDArray[np.float64]
    tile_spreads: NDArray[np.float64]


def moving_bands(
    pictures: ArrayLike,
    offsets: ArrayLike,
    cycles: ArrayLike,
    mask: ArrayLike | None = None,
) -> MovingBands:
    """Find the bands of a march in pictures at several start phases.

    Parameters
    ----------
    pictures
        Luminance at K start phases, all else equal, ``(K, H, W)``.
    offsets
        Phases, ``(K,)``, in steps: by how much each start is shifted towards its apex, K at least
        `LEAST_PHASES` and spread over a whole step.
    cycles
        Steps from the start of a march to what it sees, ``(H, W)``, a real number.
    mask
        ``(H, W)``, true where the surface is smooth and what it shows has no edge; None:
        everywhere.

    Raises
    ------
    ValueError
        Other shapes, too few phases, numbers that are not finite under the mask, fewer than two
        tiles that count, or pictures without light.
    """
    found = []
    values, phases, steps, chosen = _checked(pictures, offsets, cycles, mask)
    scale = float(values[:, chosen].mean()) if chosen.any() else 0.0
    if not scale > 0.0:
        raise ValueError(f"pictures must hold light under the mask, got a mean of {scale}.")
    values = values / scale
    for tile in _tiles(chosen.shape):
        rows, columns = np.nonzero(chosen[tile])
        light, turns = values[(slice(None), *tile)][:, rows, columns], steps[tile][rows, columns]
        if _shows_bands(turns, rows, columns):
            found.append(_tile_powers(light, phases, turns, (rows, columns)))
    if len(found) < 2:
        raise ValueError(
            f"only {len(found)} tiles of {TILE_EDGE} x {TILE_EDGE} pixels show at least "
            f"{LEAST_CYCLES:g} cycle of the march: render a larger picture, or widen the mask."
        )
    powers, spreads = np.array(found).T
    return MovingBands(
        power=_over_tiles(powers),
        spread=_over_tiles(spreads),
        tile_powers=powers,
        tile_spreads=spreads,
    )


LEAST_PHASES = 2 * HARMONIC_COUNT + 2
"""Fewest phases: a mean, two numbers for each harmonic, and one left over."""


def ratio_of_bands(first: NDArray[np.float64], second: NDArray[np.float64]) -> Estimate:
    """Return the mean of one tile-wise power over that of another, with an interval over tiles.

    Parameters
    ----------
    first, second
        Of the same tiles, ``(N,)``, N >= 2.
    """
    if first.shape != second.shape or first.ndim != 1 or len(first) < 2:
        raise ValueError(
            f"ratio_of_bands needs powers of the same two tiles or more, got {first.shape} and "
            f"{second.shape}: use one mask and one march for both."
        )
    above, below = first.sum(), second.sum()
    return estimate_from_leave_one_out(float(above / below), (above - first) / (below - second))


def _tile_powers(
    light: NDArray[np.float64],
    phases: NDArray[np.float64],
    turns: NDArray[np.float64],
    places: tuple[NDArray[np.int_], NDArray[np.int_]],
) -> tuple[float, float]:
    """Band power and spread of a tile, of light ``(K, pixels)``."""
    orders = np.arange(1, HARMONIC_COUNT + 1)
    angles = 2.0 * np.pi * orders[:, None] * phases[None, :]
    # What stands still is a wave of its own, so the phases need not be evenly spread.
    waves = np.concatenate([np.ones((1, len(phases))), np.cos(angles), np.sin(angles)])
    weights, *_ = np.linalg.lstsq(waves.T, light, rcond=None)
    cosines, sines = np.split(weights[1:], 2)
    # a cos(m phase) + b sin(m phase), of which a band has (a - i b) = A exp(i m cycles).
    waves_at = (cosines - 1j * sines) * np.exp(-2j * np.pi * orders[:, None] * turns[None, :])
    powers, pair_count = np.zeros(HARMONIC_COUNT), 0
    image, held = (
        np.zeros((HARMONIC_COUNT, TILE_EDGE, TILE_EDGE), complex),
        np.zeros((TILE_EDGE, TILE_EDGE), np.bool_),
    )
    image[:, places[0], places[1]], held[places] = waves_at, True
    for first, second in _neighbours():
        # Different pixels only: a pixel's noise agrees with itself.
        powers += (image[(..., *first)] * image[(..., *second)].conj()).real.sum(axis=(1, 2))
        pair_count += int((held[first] & held[second]).sum())
    power = float(powers.sum()) / pair_count / 2.0
    return power, float(light.var(axis=0, ddof=1).mean())


def _neighbours() -> Iterator[tuple[tuple[slice, slice], tuple[slice, slice]]]:
    """Where in a tile the first and the second pixel of each pair of neighbours lie."""
    reach = NEIGHBOUR_REACH
    for down in range(reach + 1):
        for right in range(-reach if down else 1, reach + 1):
            near, far = slice(0, TILE_EDGE - down), slice(down, TILE_EDGE)
            left = slice(max(-right, 0), TILE_EDGE - max(right, 0))
            yield (near, left), (far, slice(left.start + right, left.stop + right))


def _over_tiles(values: NDArray[np.float64]) -> Estimate:
    total, count = values.sum(), len(values)
    return estimate_from_leave_one_out(float(values.mean()), (total - values) / (count - 1))


def _tiles(shape: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    for top in range(0, shape[0], TILE_EDGE):
        for left in range(0, shape[1], TILE_EDGE):
            yield slice(top, top + TILE_EDGE), slice(left, left + TILE_EDGE)


def _shows_bands(
    turns: NDArray[np.float64], rows: NDArray[np.int_], columns: NDArray[np.int_]
) -> bool:
    """Whether a tile holds enough pixels and cycles, and not more cycles than pixels show."""
    if len(turns) < LEAST_PIXELS or np.ptp(turns) < LEAST_CYCLES:
        return False
    plane, *_ = np.linalg.lstsq(np.stack([rows, columns, np.ones(len(rows))]).T, turns, rcond=None)
    return float(np.hypot(plane[0], plane[1])) <= MOST_CYCLES_PER_PIXEL


def _checked(
    pictures: ArrayLike, offsets: ArrayLike, cycles: ArrayLike, mask: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return what was handed over as arrays that fit together."""
    values = np.asarray(pictures, dtype=np.float64)
    phases, steps = (np.asarray(each, dtype=np.float64) for each in (offsets, cycles))
    if values.ndim != 3 or steps.shape != values.shape[1:] or phases.shape != (len(values),):
        raise ValueError(
            "pictures, offsets and cycles must be (K, H, W), (K,) and (H, W), got "
            f"{values.shape}, {phases.shape} and {steps.shape}: pass luminance."
        )
    require_finite(phases, "offsets")
    if len(np.unique(np.round(phases % 1.0, 6))) < LEAST_PHASES:
        raise ValueError(
            f"offsets must hold at least {LEAST_PHASES} different phases of a step, got {phases}."
        )
    chosen = np.ones(steps.shape, dtype=np.bool_) if mask is None else np.asarray(mask)
    if chosen.dtype != np.bool_ or chosen.shape != steps.shape:
        raise ValueError(
            f"mask must be boolean and {steps.shape}, got {chosen.dtype} {chosen.shape}."
        )
    require_finite(values[:, chosen], "pictures under the mask")
    require_finite(steps[chosen], "cycles under the mask")
    return values, phases, steps, chosen
