"""What stages hand to one another about surfaces: lit points and visible points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import mitsuba as mi
import numpy as np


@dataclass
class ReflectiveShadowMap:
    """The lit points of one light, or of several.

    Attributes
    ----------
    light_name
        Which light, or how many.
    level
        The clip level that the map is made for, or None if it serves all.
    position
        World points.
    normal
        Unit geometric normals on the lit side.
    incident_flux
        Power that arrives at the texel, W.
    reflected_flux
        Power that leaves it again by reflection, W.
    light_index
        Light of each texel, as a place in the list of lights that the maps were made of; None for
        points that no emitter lit.
    radiance
        What the surface there sends out by reflection of the direct light of all emitters together,
        W m^-2 sr^-1; unbiased, and may be noisy. None where nobody asked for it.
    """

    light_name: str
    level: int | None
    position: mi.Point3f
    normal: mi.Vector3f
    incident_flux: mi.Color3f
    reflected_flux: mi.Color3f
    light_index: mi.UInt32 | None = None
    radiance: mi.Color3f | None = None

    @property
    def texel_count(self) -> int:
        """Texels that hit something."""
        return int(dr.width(self.position))


@dataclass
class LightTexels:
    """Rays of light and what they lit, those that lit nothing among them, in the order of sending.

    Attributes
    ----------
    position
        World points.
    normal
        Unit geometric normals on the lit side.
    reflected_flux
        Power that leaves again by reflection, W; 0 where nothing was lit.
    is_lit
        Whether a ray lit a surface.
    largest
        Largest channel of the reflected flux, W; NaN where the light's power is none.
    level
        Clip level that each is meant for; None: all serve all of them.
    total
        Sum of `largest`, one lane; None where nobody has asked for it yet.
    """

    position: mi.Point3f
    normal: mi.Vector3f
    reflected_flux: mi.Color3f
    is_lit: mi.Bool
    largest: mi.Float
    level: mi.UInt32 | None
    total: mi.Float | None = None

    def sum(self) -> mi.Float:
        """Return the total, which is kept for the next who asks."""
        if self.total is None:
            self.total = mi.Float(dr.sum(self.largest))
        return self.total


@dataclass
class CountedLight:
    """What became of traced light.

    Attributes
    ----------
    lost_flux_share
        Share of the reflected flux that found no opacity, for each clip level.
    texel_count
        Lit points.
    """

    lost_flux_share: list[float]
    texel_count: int


@dataclass
class FallenLight:
    """The same where it is, on the device: counted when it is asked for.

    Attributes
    ----------
    level_count
        Clip levels.
    parts
        Of each light or group of them: level, light that found opacity, and light that found none.
    is_lit
        Of each: which rays lit something.
    """

    level_count: int
    parts: list[tuple[mi.UInt32, mi.Float, mi.Float]]
    is_lit: list[mi.Bool]

    @cached_property
    def lost_flux_share(self) -> list[float]:
        """Share of the reflected flux that found no opacity, for each clip level."""
        both = np.zeros((2, self.level_count))
        for numbers, *lights in self.parts:
            # What is the same for all is one number.
            level, *weights = np.broadcast_arrays(*(np.array(each) for each in (numbers, *lights)))
            for row, weight in zip(both, weights, strict=True):
                row += np.bincount(level, weight.astype(np.float64), self.level_count)
        return [
            float(lost / (found + lost)) if found + lost > 0.0 else 0.0 for found, lost in both.T
        ]

    @cached_property
    def texel_count(self) -> int:
        """Lit points."""
        return sum(int(np.count_nonzero(np.array(each))) for each in self.is_lit)


@dataclass
class GBuffer:
    """The surface that each camera ray meets first.

    Attributes
    ----------
    sample_index
        Number of the camera ray in the picture, which random decisions hash.
    is_valid
        Whether the ray met a surface.
    position
        World point.
    normal
        Unit shading normal, turned to the viewer.
    ray_direction
        Unit direction of the ray.
    depth
        Distance along the ray, world units; 0 where nothing was met.
    albedo
        Share of light that the diffuse lobes reflect, [0, 1].
    specular_albedo
        Share of light that glossy and mirror lobes reflect, [0, 1].
    specular_axis
        Unit mean direction of those lobes.
    specular_aperture
        Full apex angle of the cone as wide as those lobes, radians.
    passed
        Share of light that passes straight through (masks, thin glass), [0, 1].
    """

    sample_index: mi.UInt32
    is_valid: mi.Bool
    position: mi.Point3f
    normal: mi.Vector3f
    ray_direction: mi.Vector3f
    depth: mi.Float
    albedo: mi.Color3f
    specular_albedo: mi.Color3f
    specular_axis: mi.Vector3f
    specular_aperture: mi.Float
    passed: mi.Color3f


@dataclass(frozen=True)
class FilmSample:
    """Says that lanes are pixels, in rows from the top left one.

    Attributes
    ----------
    width
        Pixels in a row.
    number
        Which sample of each pixel it is, from 0.
    """

    width: int
    number: int = 0
