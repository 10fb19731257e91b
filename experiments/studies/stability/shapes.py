"""Geometry that is thin, long, huge, tiny, flat, twice there, or not there at all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import mitsuba as mi
import numpy as np

from experiments.studies import closed_forms
from experiments.studies.check import StudyContext
from experiments.studies.leaking.rooms import LEVEL_BENCHES, NAME
from experiments.studies.stability.case import (
    EXACT,
    Limits,
    Outcome,
    StabilityCase,
    energy,
    largest_difference,
    mean_difference,
    refusal,
)
from experiments.studies.stability.rooms import FLOOR, Parts, bulb, mesh, render, room, standard

THICKNESSES = (0.05, 0.25, 1.0, 4.0)
"""Of a wall between a lit and a dark room, in voxels of the level that holds it."""

MOST_LEAKED = dict(zip(THICKNESSES, (0.06, 0.06, 0.03, 0.03), strict=True))
"""Most light in the dark room, over that of the lit one's walls (study "leaking")."""

SAME_ENERGY: Limits = (0.999, 1.001)
SAME: Limits = (None, 2e-3)
"""Mean difference of pictures of the same surfaces in other triangles: a few lit points fall into
the next voxel, and a few rays on the other side of an edge."""

HUGE = (1e3, 1e6)
"""Edge of a triangle, in edges of the level."""

HUGE_ENERGY: Limits = (0.99, 1.01)
"""Where single precision puts a hit on such a triangle, light starts a little off it."""

TINY_COUNT = 256
"""Quads along an edge of a floor: smaller than a cell, an eighth of a voxel."""

SLIVER = 2e-6
"""Width of a triangle that is two long."""


def cases() -> list[StabilityCase]:
    """Return the cases of geometry."""
    found = [
        StabilityCase(
            name=f"wall of {thickness:g} voxels, {place}",
            expected="next to no light behind it",
            why="one-sided slots keep the lit side's light from the dark side",
            run=partial(_leaked, place=place, thickness=thickness),
            limits={"light in the dark room": (0.0, MOST_LEAKED[thickness])},
            goals={"light in the dark room": 0.0},
            in_quick=(place, thickness) == ("in level 0", THICKNESSES[0]),
        )
        for place in LEVEL_BENCHES
        if place.startswith("in level")
        for thickness in THICKNESSES
    ]
    found += [
        _same("floor with slivers of aspect 1e6", _slivered, "slivers cover what they cover"),
        _same(
            f"floor of {2 * TINY_COUNT**2} triangles below a cell",
            _tiny,
            "coverage is a union of what triangles cover, however small",
        ),
        *(
            _same(
                f"floor of one triangle {times:g} times the level",
                partial(_huge, 2.6 * times),
                "triangles are clipped to the window before anything else",
                energy_limit=HUGE_ENERGY,
                in_quick=times == HUGE[-1],
            )
            for times in HUGE
        ),
        _same("every wall twice", _twice, "two surfaces in one place cover what one does"),
        _same(
            "ball of a millionth of a voxel",
            lambda: room(ball={"type": "sphere", "center": [0.3, 0.2, 0.1], "radius": 1e-7}),
            "it covers and sends nothing worth the name",
        ),
        _same(
            "triangles of no area",
            _with_degenerate,
            "they are counted and left out",
            EXACT,
        ),
    ]
    refusals: list[tuple[str, str, Callable[[], object], str]] = [
        ("no geometry", "there is nothing to see", _nothing, "geometry"),
        (
            "no light",
            "a picture without light has no meaning",
            lambda: render(room(lamp=None)),
            "no light",
        ),
        (
            "only triangles of no area",
            "they are no surface",
            lambda: render({"sensor": room()["sensor"], "bulb": bulb(1.0), "m": _degenerate()}),
            "zero area",
        ),
        (
            "vertex of NaN",
            "a clipped vertex would change the scene in silence",
            lambda: render(room(broken=_broken(np.nan))),
            "NaN",
        ),
        (
            "infinite vertex",
            "a clipped vertex would change the scene in silence",
            lambda: render(room(broken=_broken(np.inf))),
            "infinite",
        ),
        (
            "bulb in a one-sided ball",
            "it lights nothing but backs, which reflect nothing",
            lambda: render(
                room(
                    lamp=bulb(1.0, (0.0, 0.0, 0.0)),
                    ball={"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.2},
                )
            ),
            "backs",
        ),
    ]
    for power in (-1.0, np.nan, np.inf):
        refusals.append(
            (
                f"bulb of power {power:g}",
                "there is no such light",
                partial(_with_bulb, power),
                "negative, infinite or NaN",
            )
        )
    found += [refusal(*each) for each in refusals]
    return found


def _with_bulb(power: float) -> np.ndarray:
    return render(room(lamp=None, bulb=bulb(power)))


def _nothing() -> np.ndarray:
    return render({"sensor": room()["sensor"], "bulb": bulb(1.0)})


def _leaked(context: StudyContext, place: str, thickness: float) -> Outcome:
    bench, level = LEVEL_BENCHES[place]
    found = closed_forms.leak(context, bench, thickness * 2**level, "axis")[NAME]
    return Outcome(
        pictures=[np.array(found)],
        numbers={"light in the dark room": float(np.mean(found))},
    )


def _same(
    name: str,
    make: Callable[[], Parts],
    why: str,
    limit: Limits = SAME,
    *,
    energy_limit: Limits = SAME_ENERGY,
    in_quick: bool = True,
) -> StabilityCase:
    measure = largest_difference if limit == EXACT else mean_difference
    words = "largest difference" if limit == EXACT else "mean difference"

    def run(context: StudyContext) -> Outcome:
        truth, found = standard(context), render(make())
        numbers = {words: measure(found, truth), "energy": energy(found, truth)}
        return Outcome(pictures=[found], numbers=numbers)

    return StabilityCase(
        name=name,
        expected="the room's own picture",
        why=why,
        run=run,
        limits={"energy": energy_limit} | ({words: limit} if energy_limit == SAME_ENERGY else {}),
        in_quick=in_quick,
    )


def grid(xs: np.ndarray, zs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of a floor at y = -1 that faces up, cut at these coordinates."""
    x, z = np.meshgrid(xs, zs, indexing="ij")
    vertices = np.stack([x.ravel(), np.full(x.size, -1.0), z.ravel()], axis=1)
    row, column = np.meshgrid(np.arange(len(xs) - 1), np.arange(len(zs) - 1), indexing="ij")
    corner = (row * len(zs) + column).ravel()
    right, up = 1, len(zs)
    first = np.stack([corner, corner + right, corner + right + up], axis=1)
    second = np.stack([corner, corner + right + up, corner + up], axis=1)
    return vertices, np.concatenate([first, second])


def _floor(xs: np.ndarray, zs: np.ndarray) -> Parts:
    return room(**{FLOOR: mesh("floor", *grid(xs, zs))})


def _slivered() -> Parts:
    middles = np.linspace(-0.9, 0.9, 19)
    xs = np.sort(np.concatenate([[-1.0, 1.0], middles, middles + SLIVER]))
    return _floor(xs, np.array([-1.0, 1.0]))


def _tiny() -> Parts:
    cuts = np.linspace(-1.0, 1.0, TINY_COUNT + 1)
    return _floor(cuts, cuts)


def _huge(edge: float) -> Parts:
    # Wound as the floor; the origin lies far inside.
    corners = np.array([[-edge, -1.0, -edge], [0.0, -1.0, edge], [edge, -1.0, -edge]])
    return room(**{FLOOR: mesh("floor", corners, np.array([[0, 1, 2]]))})


def _twice() -> Parts:
    parts = room()
    return parts | {f"{name}again": part for name, part in parts.items() if name[:4] == "wall"}


def _degenerate() -> mi.Mesh:
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1], [0.2, 0.2, 0.2], [0.0, 0.3, 0.0]])
    return mesh("flat", corners, np.array([[0, 1, 2], [0, 0, 0], [3, 3, 0]]))


def _with_degenerate() -> Parts:
    return room(flat=_degenerate())


def _broken(value: float) -> mi.Mesh:
    corners = np.array([[0.0, 0.0, 0.0], [0.1, value, 0.1], [0.2, 0.0, 0.2]])
    return mesh("broken", corners, np.array([[0, 1, 2]]))
