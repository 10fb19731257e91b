"""The composite: surfaces times gathered light, as components that add up."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.scene.records import GBuffer


@dataclass
class IndirectLight:
    """Indirect light of each camera ray, W m^-2 sr^-1.

    Attributes
    ----------
    diffuse
        Reflected by diffuse lobes.
    specular
        Reflected by glossy and mirror lobes, or let through.
    """

    diffuse: mi.Color3f
    specular: mi.Color3f


def composite(
    gbuffer: GBuffer, incident_diffuse: mi.Color3f, specular: mi.Color3f | None
) -> IndirectLight:
    """Weigh gathered light with the surfaces that reflect it.

    Parameters
    ----------
    gbuffer
        Visible points.
    incident_diffuse
        E / pi at those points.
    specular
        Radiance by specular cones, or None where the scene needs none.
    """
    nothing = dr.zeros(mi.Color3f, dr.width(gbuffer.position))
    diffuse = dr.select(gbuffer.is_valid, gbuffer.albedo * incident_diffuse, nothing)
    return IndirectLight(
        diffuse=diffuse,
        specular=nothing if specular is None else dr.select(gbuffer.is_valid, specular, nothing),
    )
