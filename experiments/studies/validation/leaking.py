"""Leaks of known size: through walls, of the wrong face, and light that is missing."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from experiments.studies.check import Measured
from experiments.studies.validation.subject import Interval, Subject
from metrics.leaking import (
    LeakAudit,
    audit_shares,
    one_sided_excess,
    sealed_room_ratio,
    share_of_choices,
)
from metrics.synthetic import LeakingPicture, Noise

BATCHES = 6
KNOWN = 0.1
"""The leak of all rows: exactly a tenth of the light gathered."""

SHARES = (0.0, 0.01, 0.05, 0.1, 0.3)
WALLS_VOXELS = (4.0, 2.0, 1.0, 0.5, 0.0)
"""Thickness of a wall that lets light through, thinner and thinner."""

DECAY_VOXELS = 1.0
"""Thickness over which a leak falls to 1/e in the synthetic room."""

ROUNDING = 1e-9
CHOICES = 400

PICTURE = "half dark picture of 24 x 24, 6 batches"
NO_WALL = {"wall removed": (2.0, 0.0)}


def leak_of_wall(thickness_voxels: float) -> float:
    """Return the share of light that a synthetic wall lets through."""
    return 0.4 * math.exp(-thickness_voxels / DECAY_VOXELS)


def subjects() -> list[Subject]:
    """Return the metrics of leaking."""
    return [_sealed_room(), *_audits(), _by_choice(), *_one_sided()]


def _sealed_room() -> Subject:
    def measure(thickness: float, noise: Noise, seed: int) -> Interval:
        lit = noise(np.random.default_rng(seed), (24, 24, 3))
        return Measured(value=sealed_room_ratio(leak_of_wall(thickness) * lit, lit))

    return Subject(
        name="L1 sealed room",
        case="two rooms; a wall lets 0.4 exp(-thickness) through",
        cause="the thinness of the wall",
        measure=measure,
        causes=WALLS_VOXELS,
        known=1.0,
        answer=0.4 / math.e,
        tolerance=ROUNDING,
        zero=1e9,
        broken=lambda: sealed_room_ratio([np.nan], [1.0]),
        faults=NO_WALL,
        has_interval=False,
    )


def _audits() -> list[Subject]:
    def measure(
        cause: float, noise: Noise, seed: int, *, row: str, of: Callable[[float], LeakingPicture]
    ) -> Interval:
        return audit_shares(of(cause).audit(BATCHES, noise, seed))[row]

    def one_nan() -> object:
        audit = LeakingPicture(through=KNOWN).audit(BATCHES)
        gathered = audit.gathered.copy()
        gathered[1, 2, 3] = np.nan
        return LeakAudit(gathered=gathered, through=audit.through, truth=audit.truth)

    def through_wall(thickness: float) -> LeakingPicture:
        return LeakingPicture(through=leak_of_wall(thickness))

    def wrong_face(share: float) -> LeakingPicture:
        return LeakingPicture(wrong_face=share)

    def both(share: float) -> LeakingPicture:
        return LeakingPicture(through=0.5 * share, wrong_face=0.5 * share)

    def missing(share: float) -> LeakingPicture:
        return LeakingPicture(missing=share)

    wall = Subject(
        name="L2 through geometry",
        case=f"{PICTURE}; a wall lets 0.4 exp(-thickness) through",
        cause="the thinness of the wall",
        measure=partial(measure, row="leak_through", of=through_wall),
        causes=WALLS_VOXELS,
        known=math.log(0.4 / KNOWN),
        answer=KNOWN,
        tolerance=ROUNDING,
        zero=1e9,
        broken=one_nan,
        faults=NO_WALL,
    )
    rows = {
        "L2 wrong face": ("leak_wrong_face", wrong_face, KNOWN, KNOWN),
        "L2 leak": ("leak", both, KNOWN, KNOWN),
        "L2 missing light": ("missing_light", missing, 0.4, missing(0.4).missing_share),
    }
    return [
        wall,
        *(
            Subject(
                name=name,
                case=PICTURE,
                cause="its share",
                measure=partial(measure, row=row, of=of),
                causes=SHARES,
                known=known,
                answer=answer,
                tolerance=ROUNDING,
                broken=one_nan,
                faults={"a share of 0.3": (0.0, 0.3)},
            )
            for name, (row, of, known, answer) in rows.items()
        ),
    ]


def _by_choice() -> Subject:
    light = np.random.default_rng(7).exponential(size=CHOICES)
    hidden = np.random.default_rng(8).uniform(size=CHOICES) ** 4

    def chances(share: float) -> np.ndarray:
        found: np.ndarray = hidden * (share * light.sum() / (light * hidden).sum())
        return found

    def measure(share: float, noise: Noise, seed: int) -> Interval:
        shape = (BATCHES, CHOICES)
        if seed == 0:
            # Every outcome in proportion to its chance.
            parts = np.broadcast_to(chances(share), shape)
            return share_of_choices(np.broadcast_to(light, shape), parts)
        generator = np.random.default_rng(seed)
        blocked = generator.uniform(size=shape) < chances(share)
        return share_of_choices(light * noise(generator, shape), blocked)

    return Subject(
        name="L2 by choice",
        case=f"{CHOICES} cones, one choice each in {BATCHES} batches",
        cause="its share",
        measure=measure,
        causes=SHARES[:-1],
        known=KNOWN,
        answer=KNOWN,
        tolerance=ROUNDING,
        broken=lambda: share_of_choices(np.full((2, 3), np.nan), np.ones((2, 3))),
        faults={"a share of 0.15": (0.01, 0.15)},
    )


def _one_sided() -> list[Subject]:
    def reference(noise: Noise, seed: int) -> np.ndarray:
        truth = LeakingPicture().truth
        shape = (BATCHES, *truth.shape)
        light = truth * noise(np.random.default_rng(seed), shape)
        return np.repeat(light[..., None], 3, axis=-1)

    def measure(cause: float, noise: Noise, seed: int, *, row: str) -> Interval:
        truth = LeakingPicture().truth
        is_dark = truth == 0.0
        if row == "dark_excess":
            test = truth + is_dark * (cause * truth.sum() / is_dark.sum())
        else:
            test = (1.0 - cause) * truth
        return one_sided_excess(np.repeat(test[..., None], 3, axis=-1), reference(noise, seed))[row]

    return [
        Subject(
            name=name,
            case=PICTURE,
            cause="its share",
            measure=partial(measure, row=row),
            causes=SHARES,
            known=known,
            answer=known,
            tolerance=ROUNDING,
            broken=lambda: one_sided_excess(
                np.full((4, 4, 3), np.nan), np.ones((BATCHES, 4, 4, 3))
            ),
            faults={f"a share of {fault:g}": (0.0, fault)},
            is_bound=row == "missing_energy",
        )
        for name, row, known, fault in (
            ("L3 excess in the dark", "dark_excess", KNOWN, KNOWN),
            ("L3 over-occlusion", "missing_energy", 0.5, 0.9),
        )
    ]
