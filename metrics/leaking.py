"""Light leaking: how much of the light that cones gather came through geometry.

The audit splits the light that every pixel gathers by where its cones read it. Light from places
that the apex cannot see, because geometry lies in between, came *through*. The rest was read at
what the apex does see; where it is more than the truth there, voxels showed a face that is not the
one seen: the *wrong face* of a thin wall, or what lies beside it in the same voxel.

Only shares of the light are given, and the wrong face is told apart from the truth only after the
gain of the whole picture is taken off, so a method that is everywhere too bright by one factor does
not leak. What is missing stands beside, so that nobody trades one fault for the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.confidence import Estimate, estimate_from_leave_one_out
from metrics.finite import require_finite
from metrics.images import checked_inputs
from metrics.luminance import luminance
from metrics.measurement import Measurement

LEAST_BATCHES = 3
"""Fewest batches of an audit or a reference: one tells the sign, one gives the value, and the
jackknife leaves one out; `audit_shares` checks for that one."""

LIT_SHARE = 0.05
"""A pixel is lit if its true light is at least this share of the picture's mean."""

GAIN_TILE = 8
"""Pixels along an edge of the tiles whose light tells the gain of a picture."""

SIGMA_COUNT = 3.0
"""Standard deviations of the reference that a difference must exceed to be an excess."""

Maps = NDArray[np.float64]
"""Light of each pixel in each of M batches, ``(M, H, W)``."""


@dataclass(frozen=True, kw_only=True)
class LeakAudit:
    """Light of the pixels of a picture, in M batches of independent shadow rays, ``(M, H, W)``.

    Attributes
    ----------
    gathered
        What the cones bring, a luminance or any other linear measure of light, >= 0.
    through
        The part of it that was read at places which the apex cannot see, in [0, gathered].
    truth
        What they should bring, unbiased; noise of one batch is independent of the others'.
    """

    gathered: Maps
    through: Maps
    truth: Maps

    def __post_init__(self) -> None:
        """Refuse shapes that differ, too few batches, numbers that are not finite, and darkness."""
        shapes = {self.gathered.shape, self.through.shape, self.truth.shape}
        if len(shapes) != 1 or self.gathered.ndim != 3 or len(self.gathered) < 2:
            raise ValueError(
                "LeakAudit must hold three arrays (M, H, W) of one shape with M >= 2, "
                f"got {sorted(shapes)}: repeat the audit with other seeds."
            )
        for name in ("gathered", "through", "truth"):
            require_finite(getattr(self, name), f"LeakAudit.{name}")
        if not self.gathered.sum() > 0.0:
            raise ValueError(
                "LeakAudit.gathered must hold light, got none: nothing can have leaked."
            )


def audit_shares(
    audit: LeakAudit, where: ArrayLike | None = None, *, component: str = "indirect_diffuse"
) -> dict[str, Measurement]:
    """Return what share of the gathered light leaked, and what is missing.

    Parameters
    ----------
    audit
        Light of the whole picture.
    where
        ``(H, W)``, true for the pixels that count; the gain is always that of the whole picture.
    component
        Part of the light, for the record.

    Returns
    -------
    dict
        ``leak_through``, ``leak_wrong_face``, ``leak`` (their sum) and ``missing_light``, each over
        the light gathered. Whether a pixel has too much is decided by other batches than those
        which say how much, so noise of the truth does not count as leaking: the expectation is at
        most the true excess, and reaches it where the excess is larger than the noise.

    Raises
    ------
    ValueError
        A mask of another shape, or no light where it is true.
    """
    if len(audit.gathered) < LEAST_BATCHES:
        raise ValueError(
            f"audit must hold at least {LEAST_BATCHES} batches, got {len(audit.gathered)}: repeat "
            "it with other seeds."
        )
    chosen = _checked_where(where, audit.gathered.shape[1:])
    if not audit.gathered[:, chosen].sum() > 0.0:
        raise ValueError("audit_shares: no light is gathered where the mask is true.")

    def wrong(part: LeakAudit) -> float:
        return _share(excess_map(part, sign=1.0), part, chosen)

    def through(part: LeakAudit) -> float:
        return _share(part.through.mean(axis=0), part, chosen)

    rows: dict[str, tuple[Callable[[LeakAudit], float], str]] = {
        "leak_through": (through, "light read behind what the apex sees / light gathered"),
        "leak_wrong_face": (wrong, "sum of max(0, seen light - gain R) / light gathered"),
        "leak": (lambda part: through(part) + wrong(part), "through + wrong face"),
        "missing_light": (
            lambda part: _share(excess_map(part, sign=-1.0), part, chosen),
            "sum of max(0, gain R - seen light) / light gathered",
        ),
    }
    return {
        name: Measurement.from_estimate(
            _jackknife(statistic, audit), name=name, component=component, formula=formula, ideal=0.0
        )
        for name, (statistic, formula) in rows.items()
    }


def picture_gain(audit: LeakAudit) -> float:
    """Return the median over tiles of seen light over true light of lit pixels; 1 without any.

    A median, because light in the wrong place would change a mean: half of the tiles may be wrong
    before it moves by more than their spread. Tiles, because noise spreads the quotients of single
    pixels, and where some pixels are wrong the median of all moves with that spread.
    """
    truth = audit.truth.mean(axis=0)
    seen = (audit.gathered - audit.through).mean(axis=0)
    is_lit = truth > LIT_SHARE * max(float(truth.mean()), 0.0)
    lit_truth, lit_seen = (_tile_sums(np.where(is_lit, each, 0.0)) for each in (truth, seen))
    holds_light = lit_truth > 0.0
    if not holds_light.any():
        return 1.0
    return float(np.median(lit_seen[holds_light] / lit_truth[holds_light]))


def _tile_sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sums over tiles, which are cut off at the picture's lower and right rim."""
    height, width = values.shape
    rows = np.add.reduceat(values, np.arange(0, height, GAIN_TILE), axis=0)
    return np.asarray(np.add.reduceat(rows, np.arange(0, width, GAIN_TILE), axis=1))


def excess_map(audit: LeakAudit, sign: float) -> NDArray[np.float64]:
    """Return by how much seen light exceeds the truth times the gain, ``(H, W)``.

    Parameters
    ----------
    audit
        Light of the picture.
    sign
        1 for what is too much, -1 for what is missing.
    """
    excess = sign * (audit.gathered - audit.through - picture_gain(audit) * audit.truth)
    count = len(excess)
    others = (excess.sum(axis=0) - excess) / (count - 1)
    found: NDArray[np.float64] = np.where(others > 0.0, excess, 0.0).mean(axis=0)
    return found


def share_of_choices(
    light: ArrayLike, is_blocked: ArrayLike, *, component: str = "indirect_diffuse"
) -> Measurement:
    """Return the share of light that is blocked, from one choice for each cone.

    Parameters
    ----------
    light
        What each cone brings to the picture, ``(M, N)``, >= 0, in M batches of other choices.
    is_blocked
        Whether geometry lies between the apex and the place that was chosen among those where the
        cone read its light, with a probability in proportion to what it read there.
    component
        Part of the light, for the record.

    Notes
    -----
    The expectation over choices of ``light * is_blocked`` is the light of all blocked places, so
    the share is unbiased however few steps a cone is judged by.

    Raises
    ------
    ValueError
        Shapes that differ, fewer than two batches, numbers that are not finite, or darkness.
    """
    weights, blocked = np.asarray(light, dtype=np.float64), np.asarray(is_blocked)
    if weights.ndim != 2 or weights.shape != blocked.shape or len(weights) < 2:
        raise ValueError(
            "light and is_blocked must be (M, N) of one shape with M >= 2, got "
            f"{weights.shape} and {blocked.shape}."
        )
    require_finite(weights, "light")
    require_finite(blocked, "is_blocked")
    if not weights.sum() > 0.0:
        raise ValueError("light must not be 0 everywhere: nothing can have leaked.")
    leaked, total = (weights * blocked).sum(axis=1), weights.sum(axis=1)
    without = (leaked.sum() - leaked) / (total.sum() - total)
    estimate = estimate_from_leave_one_out(float(leaked.sum() / total.sum()), without)
    return Measurement.from_estimate(
        estimate,
        name="leak_by_choice",
        component=component,
        formula="light of cones whose chosen place is hidden / light of all cones",
        ideal=0.0,
    )


def one_sided_excess(
    test: ArrayLike, batches: ArrayLike, *, component: str = "indirect"
) -> dict[str, Measurement]:
    """L3: light where the reference is dark, and light that is missing, over all its light.

    Parameters
    ----------
    test
        ``(H, W, 3)``.
    batches
        Reference, ``(M, H, W, 3)``, M >= 3.
    component
        Part of the light, for the record.

    Returns
    -------
    dict
        ``dark_excess``: sum of max(0, V - R - 3 sigma) over pixels with R below 5 % of the mean,
        and ``missing_energy``: sum of max(0, R - V - 3 sigma) over all, each over the sum of R;
        sigma is the standard error of R. Both see luminance. No dark pixel gives 0, with a note.
        The values are bounds from below, by what sigma takes off; the high ends allow for that.

    Raises
    ------
    ValueError
        As `metrics.images.checked_inputs`, or a reference without light.
    """
    image, reference = checked_inputs(test, batches, least=LEAST_BATCHES)
    seen, truth = luminance(image), np.stack([luminance(batch) for batch in reference])
    if not truth.sum() > 0.0:
        raise ValueError(
            "batches must hold some light: without it an excess has no scale; use "
            "sealed_room_ratio for a room that is dark."
        )

    def parts(some: Maps, sigmas: float = SIGMA_COUNT) -> tuple[float, float, int]:
        mean, error = some.mean(axis=0), some.std(axis=0, ddof=1) / np.sqrt(len(some))
        is_dark = mean < LIT_SHARE * mean.mean()
        over = np.maximum(seen - mean - sigmas * error, 0.0)[is_dark].sum()
        under = np.maximum(mean - seen - sigmas * error, 0.0).sum()
        return float(over / mean.sum()), float(under / mean.sum()), int(is_dark.sum())

    whole, most = parts(truth), parts(truth, sigmas=0.0)
    without = [parts(np.delete(truth, left_out, axis=0)) for left_out in range(len(truth))]

    def estimate(place: int) -> Estimate:
        found = estimate_from_leave_one_out(
            whole[place], np.array([each[place] for each in without])
        )
        taken_off = most[place] - whole[place]
        return replace(found, high=found.high + taken_off)

    note = "" if whole[2] else "no pixel of the reference is dark"
    rows = {
        "dark_excess": (0, "sum of max(0, V - R - 3 sigma) where R is dark / sum of R"),
        "missing_energy": (1, "sum of max(0, R - V - 3 sigma) / sum of R"),
    }
    return {
        name: Measurement.from_estimate(
            estimate(place),
            name=name,
            component=component,
            formula=formula,
            ideal=0.0,
            note=note,
        )
        for name, (place, formula) in rows.items()
    }


def sealed_room_ratio(dark: ArrayLike, lit: ArrayLike) -> float:
    """L1: mean light in a sealed dark room over that in the lit one beside it; the truth is 0.

    Raises
    ------
    ValueError
        Numbers that are not finite, no pixels, or no light in the lit room.
    """
    rooms = [np.asarray(each, dtype=np.float64) for each in (dark, lit)]
    for name, room in zip(("dark", "lit"), rooms, strict=True):
        require_finite(room, name)
        if room.size == 0:
            raise ValueError(f"{name} must hold pixels, got none: the mask of the room is empty.")
    if not rooms[1].mean() > 0.0:
        raise ValueError("lit must hold light, got none: a leak has no scale then.")
    return float(rooms[0].mean() / rooms[1].mean())


def _share(part: NDArray[np.float64], audit: LeakAudit, chosen: NDArray[np.bool_]) -> float:
    """Light of a map over the light gathered, where it counts."""
    return float(part[chosen].sum() / audit.gathered.mean(axis=0)[chosen].sum())


def _jackknife(statistic: Callable[[LeakAudit], float], audit: LeakAudit) -> Estimate:
    def without(number: int) -> LeakAudit:
        maps = (audit.gathered, audit.through, audit.truth)
        gathered, through, truth = (np.delete(each, number, axis=0) for each in maps)
        return LeakAudit(gathered=gathered, through=through, truth=truth)

    left_out = [statistic(without(number)) for number in range(len(audit.gathered))]
    return estimate_from_leave_one_out(statistic(audit), np.array(left_out))


def _checked_where(where: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the mask, all true where there is none."""
    chosen = np.ones(shape, dtype=np.bool_) if where is None else np.asarray(where)
    if chosen.dtype != np.bool_ or chosen.shape != shape:
        raise ValueError(f"where must be boolean and {shape}, got {chosen.dtype} {chosen.shape}.")
    return chosen
