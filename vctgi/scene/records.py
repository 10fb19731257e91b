"""What stages hand to one another about surfaces: lit points and visible points."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


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
