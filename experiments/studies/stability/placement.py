"""The same room at any scale, far away, and mirrored."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import mitsuba as mi

import vctgi
from experiments.studies.check import StudyContext
from experiments.studies.stability.case import (
    Limits,
    Outcome,
    StabilityCase,
    energy,
    mean_difference,
)
from experiments.studies.stability.rooms import (
    ROOM_EDGE,
    WINDOW_EDGE,
    camera,
    render,
    room,
    settings,
    standard,
)
from vctgi.clipmap.levels import COARSEST_MIP_RESOLUTION

SCALES = (1e-4, 1e-2, 1e2, 1e4, 1e6)

SCALED: Limits = (None, 2e-3)
"""Mean difference: rays that meet an edge may fall on its other side when coordinates round."""

FITTED_ENERGY: Limits = (0.9, 1.1)
"""Of the clipmap that the plan fits, over one that is given: other voxels, and few cones."""

OFFSETS: dict[float, tuple[Limits, Limits]] = {
    1e3: ((0.99, 1.01), (None, 0.05)),
    1e5: ((0.8, 1.2), (None, 0.5)),
}
"""Offset in room edges, and the limits of energy and mean difference. Single precision leaves a
vertex 2^-24 of its coordinates: 2e-3 of a voxel at the first, a fifth of one at the second."""

MIRRORS = {"along x": (-1.0, 1.0, 1.0), "along all axes": (-1.0, -1.0, -1.0)}

MIRRORED_ENERGY: Limits = (0.97, 1.03)
"""Of mirrored pictures: the lamp's rays and the turns of cones are not mirrored with them."""


def cases() -> list[StabilityCase]:
    """Return the cases of scale and place."""
    found = [
        StabilityCase(
            name=f"room scaled by {scale:g}",
            expected="the same picture",
            why="radiance does not depend on the unit of length",
            run=partial(_scaled, scale=scale),
            limits={"mean difference": SCALED},
        )
        for scale in SCALES
    ]
    found += [
        StabilityCase(
            name=f"room scaled by {scale:g}, clipmap by the plan",
            expected="nearly the same picture",
            why="what the plan chooses has to follow the scene, too",
            run=partial(_fitted, scale=scale),
            limits={"energy": FITTED_ENERGY, "energy over that of scale 1": (0.999, 1.001)},
            in_quick=scale == SCALES[-1],
        )
        for scale in (SCALES[0], SCALES[-1])
    ]
    found += [
        StabilityCase(
            name=f"room {offset:g} times its size away",
            expected="the same light, but for vertices rounded to single precision",
            why="coordinates are kept to 2^-24 of themselves, which is the whole loss",
            run=partial(_moved, offset=offset),
            limits={"energy": limits[0], "mean difference": limits[1]},
            goals={"energy": 1.0, "mean difference": 0.0},
        )
        for offset, limits in OFFSETS.items()
    ]
    found += [
        StabilityCase(
            name=f"room mirrored {name}",
            expected="the light of the room",
            why="a negative scale turns the winding of triangles, not the side that is seen",
            run=partial(_mirrored, factors=factors),
            limits={"energy": MIRRORED_ENERGY},
        )
        for name, factors in MIRRORS.items()
    ]
    found.append(
        StabilityCase(
            name="room flattened a thousandfold",
            expected="sound light",
            why="every wall is a voxel or less from the one across",
            run=lambda _context: Outcome(
                pictures=[
                    render(_placed(mi.ScalarTransform4f().scale([1.0, 1e-3, 1.0]), 1e-3, 1e3))
                ]
            ),
        )
    )
    return found


def _placed(outer: Any, length: float = 1.0, reach: float = 1.0) -> dict[str, Any]:
    """Return the room after a transform, with the camera's clips scaled as the room is."""
    sensor = {**camera(outer), "near_clip": 1e-6 * length, "far_clip": 1e2 * length * reach}
    return room(outer, sensor=sensor)


def _scaled(context: StudyContext, scale: float) -> Outcome:
    found = render(_placed(mi.ScalarTransform4f().scale(scale), scale), settings(scale))
    truth = standard(context)
    return Outcome(pictures=[found], numbers={"mean difference": mean_difference(found, truth)})


def _fitted(context: StudyContext, scale: float) -> Outcome:
    given = settings()
    config = replace(given, clipmap=vctgi.preset("medium").clipmap)
    config = replace(config, clipmap=replace(config.clipmap, resolution=32))
    found = render(_placed(mi.ScalarTransform4f().scale(scale), scale), config)
    plain = context.once("stability, fitted", lambda: render(room(), config))
    numbers = {
        "energy": energy(found, standard(context)),
        "energy over that of scale 1": energy(found, plain),
    }
    return Outcome(pictures=[found, plain], numbers=numbers)


def _moved(context: StudyContext, offset: float) -> Outcome:
    # Whole steps of the window, so that the room keeps its place in the lattice.
    step = WINDOW_EDGE / COARSEST_MIP_RESOLUTION
    by = step * round(offset * ROOM_EDGE / step)
    outer = mi.ScalarTransform4f().translate([by, -by, by])
    found = render(_placed(outer), settings(centre=(by, -by, by)))
    truth = standard(context)
    return Outcome(
        pictures=[found],
        numbers={
            "energy": energy(found, truth),
            "mean difference": mean_difference(found, truth),
        },
    )


def _mirrored(context: StudyContext, factors: tuple[float, float, float]) -> Outcome:
    found = render(room(mi.ScalarTransform4f().scale(list(factors))))
    return Outcome(pictures=[found], numbers={"energy": energy(found, standard(context))})
