"""Cone geometry and cone sets over the hemisphere.

A cone set splits the cosine-weighted hemisphere into cones of equal weight: rings of equal
sin^2(theta) per cone, each ring's cones spread evenly in azimuth. A cone at polar angle theta
then covers the solid angle pi / (n cos theta). Weights sum to 1, so a constant environment of
radiance 1 gives irradiance pi to rounding. Sets of other systems: `peer_cones.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import drjit as dr
import mitsuba as mi

RINGS: dict[int, tuple[int, ...]] = {
    6: (1, 5),
    9: (1, 8),
    16: (1, 5, 10),
    17: (1, 6, 10),
    32: (1, 6, 11, 14),
    64: (1, 6, 12, 19, 26),
    256: (1, 7, 14, 21, 29, 35, 43, 49, 57),
}
"""Cones in each ring, from the pole outwards, of counts that were tuned by hand; `ring_sizes` finds
those of others."""

MAX_CONE_COUNT = 64
"""Most cones of a general set; larger ones are made for studies and have their rings here."""

FEW_CONES = 5
"""Up to so many cones stand in one ring: a cone at the pole would leave the others too low."""

ConeFrame = Literal["tangent", "world"]
"""What the axes of a set belong to: the surface, or the world."""

GOLDEN_TURN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Fraction of a turn by which each ring is twisted against the one inside it."""


@dataclass(frozen=True, kw_only=True)
class ConeSet:
    """Cones over the hemisphere around +z, or over the whole sphere.

    Attributes
    ----------
    directions
        Unit axes, one triple a cone.
    weights
        Share of E / pi that each cone gathers; they sum to 1. Of a set in the world's frame, factor
        on the share in proportion to the cosine to the normal; the shares of those above the
        surface sum to 1.
    apertures
        Full apex angles, radians.
    frame
        "tangent": around the normal, +z; "world": over the sphere, the same for every surface.
    published_gain
        What a constant environment of radiance 1 gives in the system that the set is from, in
        units of pi. It is not part of the weights.
    """

    directions: tuple[tuple[float, float, float], ...]
    weights: tuple[float, ...]
    apertures: tuple[float, ...]
    frame: ConeFrame = "tangent"
    published_gain: float = 1.0

    @property
    def cone_count(self) -> int:
        """Number of cones."""
        return len(self.weights)


def ring_cone_set(cone_count: int, aperture_scale: float = 1.0) -> ConeSet:
    """Return the cosine-stratified set of `cone_count` cones.

    Parameters
    ----------
    cone_count
        1 .. `MAX_CONE_COUNT`, or one of the keys of `RINGS`.
    aperture_scale
        Factor on each cone's aperture, > 0; 1 covers the hemisphere once.

    Raises
    ------
    ValueError
        The count is not offered.
    """
    rings = ring_sizes(cone_count)
    directions, apertures = [], []
    taken = 0
    for ring_index, ring in enumerate(rings):
        # The ring spans sin^2 from taken/n to (taken + ring)/n; its axis is the mean, but the
        # single cone of the pole looks straight up.
        sin2 = 0.0 if ring == 1 and taken == 0 else (taken + 0.5 * ring) / cone_count
        cos_theta = math.sqrt(1.0 - sin2)
        for index in range(ring):
            phi = 2.0 * math.pi * ((index + 0.5) / ring + ring_index * GOLDEN_TURN)
            directions.append(
                (math.sqrt(sin2) * math.cos(phi), math.sqrt(sin2) * math.sin(phi), cos_theta)
            )
            solid_angle = math.pi / (cone_count * cos_theta)
            apertures.append(aperture_scale * aperture_from_solid_angle(solid_angle))
        taken += ring
    return ConeSet(
        directions=tuple(directions),
        weights=(1.0 / cone_count,) * cone_count,
        apertures=tuple(apertures),
    )


def ring_sizes(cone_count: int) -> tuple[int, ...]:
    """Cones in each ring of a set, from the pole outwards.

    Cosine-weighted directions are evenly spread points of the unit disc. One cell lies in its
    middle; the rest is cut into rings about as wide as a cell, which hold cells by their area.

    Raises
    ------
    ValueError
        The count is not offered.
    """
    if cone_count in RINGS:
        return RINGS[cone_count]
    if not 1 <= cone_count <= MAX_CONE_COUNT:
        raise ValueError(
            f"ring_cone_set: no set of {cone_count} cones; choose 1 .. {MAX_CONE_COUNT} or "
            f"{max(RINGS)}."
        )
    if cone_count <= FEW_CONES:
        return (cone_count,)
    middle = 1.0 / math.sqrt(cone_count)
    ring_count = max(1, round((1.0 - middle) / math.sqrt(math.pi / cone_count)))
    rims = [middle + (1.0 - middle) * k / ring_count for k in range(ring_count + 1)]
    # Rounding what has been taken so far, so that the rings sum to the count.
    taken = [round(cone_count * rim**2) for rim in rims]
    return (1, *(after - before for before, after in pairwise(taken)))


def ring_rims(cone_count: int) -> list[tuple[float, float]]:
    """Return the squared sines of the elevations between which each cone's ring lies.

    Raises
    ------
    ValueError
        The count is not offered.
    """
    rims, taken = [], 0
    for ring in ring_sizes(cone_count):
        rims += [(taken / cone_count, (taken + ring) / cone_count)] * ring
        taken += ring
    return rims


def aperture_from_solid_angle(solid_angle: float) -> float:
    """Full apex angle (radians) of the cone that covers `solid_angle` (steradians)."""
    return 2.0 * math.acos(max(-1.0, 1.0 - solid_angle / (2.0 * math.pi)))


def ratio_from_aperture(aperture: float) -> float:
    """Cone ratio 2 tan(aperture / 2): footprint diameter over distance."""
    return 2.0 * math.tan(0.5 * aperture)


def aperture_from_mean_cosine(mean_cosine: mi.Float) -> mi.Float:
    """Full apex angle of the cone whose directions have the given mean resultant length.

    Directions spread evenly over a cone of half angle h have the mean vector (1 + cos h) / 2 along
    its axis. Inverting it gives the cone that is as wide as a lobe of that mean vector.

    Parameters
    ----------
    mean_cosine
        Length of the mean of unit directions, in [0, 1].

    Returns
    -------
    mi.Float
        Radians, in [0, 2 pi].
    """
    return 2.0 * dr.safe_acos(2.0 * mean_cosine - 1.0)
