"""Study "aliasing": whether light flows from voxel to voxel as smoothly as what sends it moves.

A lamp, an object, the windows around a viewer and the whole scene are moved in steps of a 16th of a
voxel, while all that is lit lies in one clip level. See `metrics/aliasing.py` for the measures.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from experiments.studies.aliasing import truth, turned_cube
from experiments.studies.aliasing.figures import DEFINITIONS as DEFINITIONS
from experiments.studies.aliasing.moved_rooms import (
    FINEST_VOXEL,
    HOWS,
    LEVELS,
    MOVERS,
    PATHS,
    PERIODS,
    QUICK_HOWS,
    MovedRoom,
    moved_room,
    recentred,
)
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.noise import require_told_apart
from metrics.aliasing import (
    pop_share,
    power_ripple,
    recentring_difference,
    temporal_difference_error,
    temporal_difference_rms,
)
from metrics.energy import energy_ratio
from metrics.measurement import Measurement
from metrics.voxel_period import voxel_period_rms, voxel_period_share

SMOOTH = "scatter 3 wide"
"""The way to inject that is asked to be smooth."""

HEADLINES = ("power ripple", "temporal difference, RMS")
"""What of it is read first."""

CONFIGURATION = 'preset "high" cones, four levels of 32^3'

QUICK_LEVEL = 1
"""The level in which things move in the quick version."""

LARGEST_RIPPLE = 0.01
ROUNDING = 1e-4
"""Relative: single precision in scenes that are moved by several windows."""

FAULTY_MOVE = 0.5
"""Of the planted fault, in voxels of the finest level."""

Measure = Callable[[MovedRoom, str], Measurement]

MEASURES: dict[str, Measure] = {
    "power ripple": lambda found, how: power_ripple(found.powers[how]),
    "temporal difference error": lambda found, how: temporal_difference_error(
        found.light[how], found.batches
    ),
    "temporal difference, RMS": lambda found, how: temporal_difference_rms(
        found.light[how], found.batches
    ),
    "pops": lambda found, how: pop_share(found.light[how], found.batches),
    "voxel period, RMS": lambda found, how: voxel_period_rms(
        found.light[how], found.batches, found.places
    ),
    "voxel period, share of energy": lambda found, how: voxel_period_share(
        found.light[how], found.batches, found.places
    ),
    "energy": lambda found, how: energy_ratio(found.light[how], found.batches),
}
"""What is measured of each sweep."""

COMPARED = tuple(name for name in MEASURES if name != "power ripple")
"""What is measured against a reference."""

NOT_OF_CAMERAS = ("power ripple", "voxel period, RMS", "voxel period, share of energy")
"""Moved windows hold other things each time, so nothing comes back."""


def checks() -> list[Check]:
    """Return the checks of injection aliasing."""
    found = []
    for mover in MOVERS:
        for level in range(LEVELS):
            for how in HOWS:
                found += [
                    _check(name, mover, level, how)
                    for name in MEASURES
                    if not (mover == "camera" and name in NOT_OF_CAMERAS)
                ]
    return [*found, *_recentring_checks(), *truth.checks(), *turned_cube.checks()]


def _check(name: str, mover: str, level: int, how: str) -> Check:
    is_held = name == "power ripple" and how == SMOOTH
    return Check(
        name=f"moved {mover}, level {level}, {name}, {how}",
        configuration=f"{CONFIGURATION}; {how}",
        scene=f"room two wide, lit in voxels of {FINEST_VOXEL * 2.0**level:g}, "
        f"moved by {PERIODS[mover]} of them",
        measure=partial(_measure, name=name, mover=mover, level=level, how=how),
        limit_high=LARGEST_RIPPLE if is_held else None,
        goal=1.0 if name == "energy" else 0.0,
        in_quick=level == QUICK_LEVEL and how in QUICK_HOWS,
        is_headline=level == QUICK_LEVEL and how == SMOOTH and name in HEADLINES,
    )


def _measure(context: StudyContext, name: str, mover: str, level: int, how: str) -> Measured:
    room = moved_room(context, mover, level, how)
    if name in COMPARED:
        require_told_apart(
            room.light[how], room.batches, PATHS[context.quick], "the reference of the receivers"
        )
    found = MEASURES[name](room, how)
    return Measured(value=found.value, low=found.low, high=found.high)


def _recentring_checks() -> list[Check]:
    return [
        Check(
            name=f"moved by whole voxels, largest difference, {how}",
            configuration=f"{CONFIGURATION}; {how}",
            scene="room two wide, moved with its windows by 8, -8 and 16 voxels of the coarsest",
            measure=partial(_recentring, how=how),
            # The nearest of all texels may be another one after rounding.
            limit_high=None if how == "centre" else ROUNDING,
            goal=0.0,
        )
        for how in HOWS
    ] + [
        Check(
            name=f"planted fault, moved by {FAULTY_MOVE:g} voxel besides, {SMOOTH}",
            configuration=f"{CONFIGURATION}; {SMOOTH}",
            scene="room two wide, moved by half a voxel of the finest level more than its windows",
            measure=partial(_recentring, how=SMOOTH, besides=FAULTY_MOVE),
            limit_low=100.0 * ROUNDING,
        )
    ]


def _recentring(context: StudyContext, how: str, besides: float = 0.0) -> Measured:
    return Measured(value=recentring_difference(*recentred(context, how, besides)))
