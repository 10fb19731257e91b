"""Cone sets of other systems, as facts restated; their weights made to sum to 1.

Where a system's own weights do not sum to 1, what they give stands beside the set as
`ConeSet.published_gain` and is applied only when asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from vctgi.maths.cones import ConeSet, aperture_from_solid_angle

Axis = tuple[float, float, float]

SIXTY_DEGREES = math.radians(60.0)

CRASSIN_WEIGHTS = (0.25, 0.15)
"""Share of the cone along the normal, and of each of the five around it."""

ORBIT_OF_16 = (0.903007, 0.182696, 0.388844)
"""One of the twelve axes that, with the corners of a tetrahedron, make the sphere's sixteen."""

ORBIT_OF_32 = (0.898904, 0.435512, 0.0479745)
"""One of the 24 axes that, with the corners of a cube, make its 32."""

COMPIX_DIVISOR = 0.5
"""compix divides the sum of cosines by this times the cones of the whole sphere."""

STRIDE_OUTER = 0.445
"""Height of the outer ring of Stride's six, and its weight against the middle one's of 1."""

STRIDE_STRAY = (0.895, 0.445, 0.445)
"""Where Stride's sixth axis points; a regular ring would have (0, 0.895, 0.445) there."""

STRIDE_HEIGHTS = (0.84, 0.22)
"""Heights and weights of the two rings, of four and eight, of Stride's twelve."""

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def peer_cone_set(name: str, aperture_scale: float = 1.0) -> ConeSet:
    """Return the cone set of another system.

    Parameters
    ----------
    name
        One of the keys of `PEER_CONE_SETS`.
    aperture_scale
        Factor on each cone's aperture, > 0.

    Raises
    ------
    ValueError
        No set of that name.
    """
    if name not in PEER_CONE_SETS:
        raise ValueError(
            f"peer_cone_set: no set '{name}'; choose one of {', '.join(PEER_CONE_SETS)}."
        )
    cones = PEER_CONE_SETS[name]()
    return replace(cones, apertures=tuple(aperture_scale * each for each in cones.apertures))


def _set(
    directions: Sequence[Axis], weights: Sequence[float], aperture: float, gain: float = 1.0
) -> ConeSet:
    """Return a set of one aperture, its axes and weights normalised."""
    axes = np.array(directions, dtype=np.float64)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    total = math.fsum(weights)
    return ConeSet(
        directions=tuple((float(x), float(y), float(z)) for x, y, z in axes),
        weights=tuple(weight / total for weight in weights),
        apertures=(aperture,) * len(weights),
        published_gain=gain,
    )


def _ring(count: int, height: float, turn: float = 0.0) -> list[Axis]:
    """Axes evenly spread around the normal at one cosine to it."""
    sine = math.sqrt(1.0 - height * height)
    angles = [turn + 2.0 * math.pi * index / count for index in range(count)]
    return [(sine * math.cos(phi), sine * math.sin(phi), height) for phi in angles]


def _one_and_five(height: float, aperture: float, gain: float = 1.0) -> ConeSet:
    """One cone along the normal and five around it [Crassin2011]."""
    axis, side = CRASSIN_WEIGHTS
    return _set([(0.0, 0.0, 1.0), *_ring(5, height)], [axis] + [side] * 5, aperture, gain)


def _four() -> ConeSet:
    """Four cones of a right angle at 45 degrees: Godot's and Ogre's fast setting."""
    return _set(_ring(4, math.sqrt(0.5)), [0.25] * 4, math.radians(90.0))


def _friduric() -> ConeSet:
    """One along the normal, four sides, four corners; their sum is multiplied by 0.52."""
    sides: list[Axis] = [(1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), (0.0, 1.0, 1.0), (0.0, -1.0, 1.0)]
    corners: list[Axis] = [(0.5 * x, 0.5 * y, 1.0) for x in (1.0, -1.0) for y in (1.0, -1.0)]
    axes: list[Axis] = [(0.0, 0.0, 1.0), *sides, *corners]
    return _set(axes, [1.0] * 9, 2.0 * math.atan(0.325), gain=9.0 * 0.52)


def _stride_six() -> ConeSet:
    """One and five, the last of which strays."""
    regular = _ring(5, STRIDE_OUTER, turn=0.5 * math.pi)
    axes = [(0.0, 0.0, 1.0), *regular[1:], STRIDE_STRAY]
    return _set(axes, [1.0] + [STRIDE_OUTER] * 5, SIXTY_DEGREES)


def _stride_twelve() -> ConeSet:
    """Rings of four and eight, which Stride's own axes keep to within a few degrees."""
    high, low = STRIDE_HEIGHTS
    return _set([*_ring(4, high), *_ring(8, low)], [high] * 4 + [low] * 8, 2.0 * math.atan(0.5))


def _three_js() -> ConeSet:
    """Three cones, cosine-stratified along a spiral; the system turns them pixel by pixel."""
    axes: list[Axis] = []
    for index in range(3):
        sine, phi = math.sqrt((index + 0.5) / 3.0), index * GOLDEN_ANGLE
        axes.append((sine * math.cos(phi), sine * math.sin(phi), math.sqrt(1.0 - sine * sine)))
    return _set(axes, [1.0] * 3, math.radians(40.0))


def _hammersley(count: int) -> ConeSet:
    """Cosine-distributed Hammersley points, each cone as wide as its share of the hemisphere."""
    axes: list[Axis] = []
    apertures = []
    for index in range(count):
        u, phi = (index + 0.5) / count, 2.0 * math.pi * _radical_inverse(index)
        cosine = math.sqrt(1.0 - u)
        axes.append((math.sqrt(u) * math.cos(phi), math.sqrt(u) * math.sin(phi), cosine))
        apertures.append(aperture_from_solid_angle(math.pi / (count * cosine)))
    return replace(_set(axes, [1.0] * count, 0.0), apertures=tuple(apertures))


def _radical_inverse(index: int) -> float:
    """Binary digits of a number mirrored at the point."""
    found, digit = 0.0, 0.5
    while index:
        found += digit * (index & 1)
        index, digit = index >> 1, 0.5 * digit
    return found


def _sphere(axes: Sequence[Axis], aperture: float, gain: float = 1.0) -> ConeSet:
    """Return a set in the world's frame, each cone weighted by its cosine to the normal."""
    return replace(_set(axes, [1.0] * len(axes), aperture, gain), frame="world")


def _sixteen(gain: float) -> ConeSet:
    """Corners of a tetrahedron, and twelve axes that its rotations take to one another."""
    corners = [(x, y, x * y) for x in (1.0, -1.0) for y in (1.0, -1.0)]
    orbit = []
    for x, y in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        a, b, c = x * ORBIT_OF_16[0], y * ORBIT_OF_16[1], -x * y * ORBIT_OF_16[2]
        orbit += [(a, b, c), (c, a, b), (b, c, a)]
    return _sphere([*corners, *orbit], math.radians(50.0), gain)


def _thirty_two(gain: float) -> ConeSet:
    """Corners of a cube, and 24 axes that its rotations take to one another."""
    signs = (1.0, -1.0)
    corners = [(x, y, z) for x in signs for y in signs for z in signs]
    orbit = []
    for x in signs:
        for y in signs:
            for z in signs:
                a, b, c = x * ORBIT_OF_32[0], y * ORBIT_OF_32[1], z * ORBIT_OF_32[2]
                # Even permutations keep the handedness, odd ones turn it over, as an odd number of
                # mirrored axes does.
                even = [(a, b, c), (b, c, a), (c, a, b)]
                odd = [(a, c, b), (c, b, a), (b, a, c)]
                orbit += even if x * y * z > 0.0 else odd
    return _sphere([*corners, *orbit], math.radians(36.0), gain)


def _six_axes() -> ConeSet:
    """Return the world's axes; with the cosine alone they give 1 .. sqrt(3), on average 1.5."""
    units = np.concatenate([np.eye(3), -np.eye(3)])
    axes: list[Axis] = [(float(x), float(y), float(z)) for x, y, z in units]
    return _sphere(axes, math.radians(90.0), gain=1.5)


PEER_CONE_SETS: dict[str, Callable[[], ConeSet]] = {
    "crassin6": partial(_one_and_five, 0.5, SIXTY_DEGREES),
    # Adding the normal to the axes of the ring brings them from 60 to 40.9 degrees; the weights sum
    # to pi, and nothing divides by it again.
    "vctrenderer6": partial(_one_and_five, 1.0 / math.sqrt(1.75), SIXTY_DEGREES, math.pi),
    "four": _four,
    "friduric9": _friduric,
    "stride6": _stride_six,
    "stride12": _stride_twelve,
    "threejs3": _three_js,
    "hanetaka8": partial(_hammersley, 8),
    "hanetaka16": partial(_hammersley, 16),
    "hanetaka32": partial(_hammersley, 32),
    "compix16": partial(_sixteen, COMPIX_DIVISOR),
    "compix32": partial(_thirty_two, COMPIX_DIVISOR),
    "wicked16": partial(_sixteen, 1.0),
    "wicked32": partial(_thirty_two, 1.0),
    "strayphotons6": _six_axes,
}
"""Cone sets by name."""
