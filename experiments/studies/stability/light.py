"""Light from next to nothing to far too much, in odd places and in crowds."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from experiments.studies.check import StudyContext
from experiments.studies.stability.case import (
    EXACT,
    Limits,
    Outcome,
    StabilityCase,
    energy,
    largest_difference,
    mean_difference,
)
from experiments.studies.stability.rooms import (
    ALBEDO,
    RADIANCE,
    Parts,
    bulb,
    diffuse,
    grey,
    lamp,
    render,
    room,
    standard,
    walls,
)

FACTORS = (1e-20, 1e-8, 1e-4, 1e4, 1e8, 1e20)

ROUNDING: Limits = (None, 1e-5)
"""Some hundred operations in single precision."""

CHANGE = 0.01
CONDITION: Limits = (0.999, 1.001)
"""Of a linear map, within rounding over the change."""

NOISE: Limits = (None, 0.1)
"""Mean difference between two light maps of about 10 texels a voxel."""

ENERGY_NOISE: Limits = (0.97, 1.03)
"""The same in the mean of the picture."""

CROWD = 1000
CROWD_NOISE: Limits = (None, 0.2)
"""The same of a thousand maps of a few dozen texels each, whose places know nothing of each other
where one map spreads its texels evenly."""

LEAKED = "light outside, over the radiance inside"


def cases() -> list[StabilityCase]:
    """Return the cases of light."""
    found = [
        StabilityCase(
            name=f"lamp {factor:g} times as bright",
            expected="the same picture, scaled; condition number 1",
            why="light is linear, and no threshold knows how bright a scene is",
            run=partial(_scaled, factor=factor),
            limits={"largest difference": ROUNDING, "condition number": CONDITION},
        )
        for factor in FACTORS
    ]
    found += [
        _equal("lamp without power beside a lit one", _dark_beside, EXACT, "it sends nothing"),
        _equal(
            "two lamps of half the power in one place",
            lambda: room(lamp=lamp(RADIANCE / 2.0), twin=lamp(RADIANCE / 2.0)),
            NOISE,
            "together they send what one does; which of two coplanar ones a ray leaves is chance",
            ENERGY_NOISE,
        ),
        _equal(
            "lamp exactly in the ceiling",
            lambda: room(lamp=lamp(height=1.0)),
            NOISE,
            "two surfaces in one plane are lit and seen as one just below it",
            ENERGY_NOISE,
            lambda: room(lamp=lamp(height=0.999)),
        ),
        _equal(
            f"{CROWD} bulbs in one point",
            lambda: _bulbs(CROWD, spread=0.0),
            CROWD_NOISE,
            "they send what one does, and none is lost when texels are dealt among many",
            ENERGY_NOISE,
            lambda: room(lamp=None, bulb=bulb(3.0)),
        ),
        StabilityCase(
            name=f"{CROWD} bulbs all over the room",
            expected="sound light",
            why="there are fewer texels for each than voxels that it lights",
            run=lambda _context: Outcome(pictures=[render(_bulbs(CROWD, spread=0.8))]),
        ),
        StabilityCase(
            name="bulb exactly on a wall",
            expected="sound light",
            why="half of its rays start on the surface, and what they meet first is rounding",
            run=lambda _context: Outcome(
                pictures=[render(room(lamp=None, bulb=bulb(3.0, (0.2, 0.1, -1.0))))]
            ),
        ),
        StabilityCase(
            name="bulb exactly in a corner",
            expected="sound light",
            why="three surfaces are at distance 0",
            run=lambda _context: Outcome(
                pictures=[render(room(lamp=None, bulb=bulb(3.0, (-1.0, -1.0, -1.0))))]
            ),
        ),
        StabilityCase(
            name="bulb in a two-sided ball",
            expected="next to no light outside it",
            why="no light leaves a closed ball, and its wall keeps its two sides apart",
            run=_bulb_in_ball,
            limits={LEAKED: (0.0, 0.03)},
            goals={LEAKED: 0.0},
        ),
        _black("only lamps without power", lambda: room(lamp=lamp(0.0)), "they send nothing"),
        _black(
            "only an emitter",
            lambda: {"sensor": room()["sensor"], "lamp": lamp()},
            "what shines has nothing to be reflected by",
        ),
        _black(
            "room that reflects nothing",
            lambda: room(**_walls_of(diffuse(0.0))),
            "there is no indirect light without a reflection",
        ),
        _black(
            "constant sky without power",
            lambda: room(lamp=None, sky={"type": "constant", "radiance": grey(0.0)}),
            "it sends nothing",
        ),
    ]
    return found


def _walls_of(bsdf: Parts) -> Parts:
    return walls(bsdf=bsdf)


def _scaled(context: StudyContext, factor: float) -> Outcome:
    truth = standard(context).astype(np.float64)
    found = render(room(lamp=lamp(RADIANCE * factor)))
    nudged = render(room(lamp=lamp(RADIANCE * factor * (1.0 + CHANGE))))
    response = float(nudged.mean(dtype=np.float64) / found.mean(dtype=np.float64)) - 1.0
    return Outcome(
        pictures=[found, nudged],
        numbers={
            "largest difference": largest_difference(found / np.float64(factor), truth),
            "condition number": response / CHANGE,
        },
    )


def _equal(
    name: str,
    make: Any,
    limit: Limits,
    why: str,
    energy_limit: Limits | None = None,
    make_truth: Any = None,
) -> StabilityCase:
    """Return a case that must look as the room does, or as another scene."""
    measure = largest_difference if limit == EXACT else mean_difference
    words = "largest difference" if limit == EXACT else "mean difference"

    def run(context: StudyContext) -> Outcome:
        truth = standard(context) if make_truth is None else render(make_truth())
        found = render(make())
        numbers = {words: measure(found, truth), "energy": energy(found, truth)}
        return Outcome(pictures=[found], numbers=numbers)

    limits = {words: limit} | ({} if energy_limit is None else {"energy": energy_limit})
    return StabilityCase(name=name, expected="the same picture", why=why, run=run, limits=limits)


def _black(name: str, make: Any, why: str) -> StabilityCase:
    def run(_context: StudyContext) -> Outcome:
        found = render(make())
        return Outcome(pictures=[found], numbers={"light": float(np.abs(found).max())})

    return StabilityCase(
        name=name, expected="a black picture", why=why, run=run, limits={"light": EXACT}
    )


def _dark_beside() -> Parts:
    return room(off=bulb(0.0))


def _bulbs(count: int, spread: float) -> Parts:
    places = np.random.default_rng(0).uniform(-spread, spread, (count, 3))
    if spread == 0.0:
        places[:] = (0.2, 0.1, -0.3)
    bulbs = {
        f"bulb{number}": bulb(3.0 / count, (float(x), float(y), float(z)))
        for number, (x, y, z) in enumerate(places)
    }
    return room(lamp=None, **bulbs)


def _bulb_in_ball(_context: StudyContext) -> Outcome:
    radius, intensity = 0.25, 3.0
    shade = {"type": "sphere", "center": [0.2, 0.1, -0.3], "radius": radius}
    closed = {**shade, "bsdf": {"type": "twosided", "bsdf": diffuse()}}
    found = render(room(lamp=None, bulb=bulb(intensity), ball=closed))
    inside = intensity / radius**2 * ALBEDO / math.pi
    # Irradiance over pi, without the reflection.
    outside = float(found[..., :3].mean()) / ALBEDO
    return Outcome(pictures=[found], numbers={LEAKED: outside / inside})
