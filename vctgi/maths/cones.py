"""Cone geometry and cone sets over the hemisphere.

A cone set splits the cosine-weighted hemisphere into cones of equal weight: rings of equal
sin^2(theta) per cone, each ring's cones spread evenly in azimuth. A cone at polar angle theta
then covers the solid angle pi / (n cos theta). Weights sum to 1, so a constant environment of
radiance 1 gives irradiance pi to rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
"""Cones in each ring, from the pole outwards, of the sets that are offered."""

GOLDEN_TURN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Fraction of a turn by which each ring is twisted against the one inside it."""


@dataclass(frozen=True, kw_only=True)
class ConeSet:
    """Cones over the hemisphere around +z.

    Attributes
    ----------
    directions
        Unit axes in the tangent frame, one triple a cone.
    weights
        Share of E / pi that each cone gathers; they sum to 1.
    apertures
        Full apex angles, radians.
    """

    directions: tuple[tuple[float, float, float], ...]
    weights: tuple[float, ...]
    apertures: tuple[float, ...]

    @property
    def cone_count(self) -> int:
        """Number of cones."""
        return len(self.weights)


def ring_cone_set(cone_count: int, aperture_scale: float = 1.0) -> ConeSet:
    """Return the cosine-stratified set of `cone_count` cones.

    Parameters
    ----------
    cone_count
        One of the keys of `RINGS`.
    aperture_scale
        Factor on each cone's aperture, > 0; 1 covers the hemisphere once.

    Raises
    ------
    ValueError
        The count is not offered.
    """
    if cone_count not in RINGS:
        known = ", ".join(str(count) for count in sorted(RINGS))
        raise ValueError(
            f"ring_cone_set: no set of {cone_count} cones; choose one of {known}, "
            "or add its rings to RINGS."
        )
    directions, apertures = [], []
    taken = 0
    for ring_index, ring in enumerate(RINGS[cone_count]):
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
