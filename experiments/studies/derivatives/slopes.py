"""Derivatives of the room's mean picture at one place, one for each seed of the cones' phases.

The cones of all points share no phase, but a picture still has a kink wherever a sample passes from
one voxel to the next, so its slope at a point scatters around that over a step. Seeds are
independent, and all ways to take a derivative see the same: what they differ by has an interval.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from experiments.studies.check import StudyContext, mean_of
from experiments.studies.derivatives.measure import (
    MODES,
    Picture,
    by_differences,
    mean_picture,
    moved,
)
from experiments.studies.derivatives.room import SCENE_NAMES, DerivativeRoom, derivative_room
from experiments.studies.figures import Table
from reports.study_figures import Bounded
from vctgi.config import RenderConfig

Way = Literal["forward", "reverse", "fine", "coarse", "mean"]
"""A mode, differences of a step, or the picture itself."""

STEPS: dict[Way, float] = {"fine": 1e-4, "coarse": 1e-2}
"""Relative steps of the differences."""

SEEDS = (4, 1)
"""Seeds to begin with, in the whole study and in the quick one."""

MOST_SEEDS = 128
"""Seeds at which a difference that its interval does not tell from its limit is left undecided."""

TABLE = Table(
    group="Each way to a derivative",
    title="All ways, side by side",
    caption="Derivative of the mean picture by a parameter's share, over the mean picture: 0.1 is "
    "0.1 % more light for 1 % more of the parameter; each of several values is moved by 1 to 1.5 "
    "times the share. Bias: of cones' parameters, differences of step 0.01 off the mean derivative "
    "over that step; of the scene's, cones over prb, less 1. All columns but prb's are of the same "
    f"{SEEDS[0]} seeds of the phases (quick: {SEEDS[1]}), to be compared; rows add seeds where "
    "these leave them undecided.",
    line_label="parameter",
    columns=("forward mode", "reverse mode", "step 0.0001", "step 0.01", "prb", "bias"),
)
"""What is found, beside how far it is off."""

COLUMNS: dict[Way, str] = dict(
    zip(("forward", "reverse", "fine", "coarse"), TABLE.columns[:4], strict=True)
)
"""Where in the table each way stands."""


@dataclass(frozen=True)
class Place:
    """Where derivatives are taken.

    Attributes
    ----------
    name
        The parameter; of the scene's, also by how much light: "..., three scatterings".
    factor
        On its values.
    least
        Transmittance below which cones end; None: that of the preset.
    """

    name: str
    factor: float = 1.0
    least: float | None = None

    @property
    def line(self) -> str:
        """Return its name in the table."""
        return self.name if self.factor == 1.0 else f"{self.name}, times {self.factor:g}"


def slopes(context: StudyContext, place: Place, way: Way, count: int) -> np.ndarray:
    """Return derivatives by a share, or mean pictures, for so many seeds, each made once."""
    return np.array(
        [
            context.once(
                f"derivatives, {place}, {way}, {seed}", partial(_slope, context, place, way, seed)
            )
            for seed in range(count)
        ]
    )


def first_seed_count(context: StudyContext) -> int:
    """Return how many seeds there are to begin with."""
    return SEEDS[int(context.quick)]


def tabulate(context: StudyContext, place: Place, ways: tuple[Way, ...]) -> None:
    """Put derivatives over the mean picture into the table, of the seeds that all ways begin with.

    A comparison may need more seeds than another; columns of unlike seeds would differ by noise.
    """
    count = first_seed_count(context)
    mean = float(np.mean(slopes(context, place, "mean", count)))
    cells = {}
    for way in ways:
        found = mean_of([float(each) / mean for each in slopes(context, place, way, count)])
        cells[COLUMNS[way]] = Bounded(value=found.value, low=found.low, high=found.high)
    context.shelf.add_cells(TABLE, place.line, cells)


def picture_at(room: DerivativeRoom, place: Place, seed: int) -> tuple[Picture, Any]:
    """Return the picture as a function of a parameter, and where the parameter is."""
    config = _config(room.config, place)
    name = place.name.partition(",")[0]
    if name in SCENE_NAMES:
        key = SCENE_NAMES[name]
        room.start.setdefault(key, type(room.scene_parameters[key])(room.scene_parameters[key]))
        return room.with_scene(key, config, seed), _scaled(room.start[key], place.factor)
    return room.with_cones(name, config, seed), _scaled(room.cones()[name], place.factor)


def _config(config: RenderConfig, place: Place) -> RenderConfig:
    if place.name.endswith("three scatterings"):
        config = replace(config, scattering_count=3)
    if place.least is not None:
        march = replace(config.diffuse.march, min_transmittance=place.least)
        config = replace(config, diffuse=replace(config.diffuse, march=march))
    return config


def _slope(context: StudyContext, place: Place, way: Way, seed: int) -> float:
    room = derivative_room(context)
    picture, start = picture_at(room, place, seed)
    if way == "mean":
        return mean_picture(picture, moved(start, 0.0))
    if way in STEPS:
        return by_differences(picture, start, STEPS[way])
    mode: Callable[[Picture, Any], float] = MODES[way]
    found = mode(picture, start)
    room.restore()
    return found


def _scaled(start: Any, factor: float) -> Any:
    """Return values times a factor."""
    kind = type(start)
    return kind(np.float32(np.array(start, dtype=np.float64) * factor))
