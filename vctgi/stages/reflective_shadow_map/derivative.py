"""Derivatives of light by where lamps and lit surfaces are, at lit points that stay where they are.

A lit point moves when its light does, and passes from voxel to voxel in jumps. The light that a
voxel gets does not: it is an integral over the surfaces in it. So the derivative is taken at fixed
points of the surfaces: the power of a texel is the irradiance there times an area that does not
change, and its derivative that of the irradiance. A surface that moves takes its points along its
normal.

Not seen: what begins or ceases to be lit, at the rims of shadows; textures that move with their
surface; how much a glossy surface reflects of light that comes from elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.maths.stub_gaps import as_component
from vctgi.scene.derivatives import has_moving_parts
from vctgi.scene.lights import Light


@dataclass
class RayOrigins:
    """What the rays of lights were made from, so that they can be followed.

    Attributes
    ----------
    lights
        All lights.
    owner
        Place of each ray's light in the list.
    position, direction
        Sample of its place on the lamp, and of its direction, [0, 1)^2.
    share
        Share of its light's power that a ray carries.
    """

    lights: list[Light]
    owner: mi.UInt32
    position: mi.Point2f
    direction: mi.Point2f
    share: mi.Float


def anything_moves(lights: list[Light]) -> bool:
    """Whether any light has derivatives by where it is or by where it shines."""
    return any(has_moving_parts(light.emitter) for light in lights)


@dataclass
class Landing:
    """Where rays of light landed.

    Attributes
    ----------
    si
        The surfaces; they may have derivatives.
    direction
        Unit directions of the rays.
    number
        Numbers of the rays.
    flux
        Power of each, W, before it meets the surface.
    turned
        Factor on it by which shading normals change the irradiance.
    """

    si: mi.SurfaceInteraction3f
    direction: mi.Vector3f
    number: mi.UInt32
    flux: mi.Color3f
    turned: mi.Float


def follow_lights(landing: Landing, origins: RayOrigins) -> tuple[mi.Color3f, mi.Color3f]:
    """Return the power that arrives, and the same as shading sees it, with derivatives."""
    incident = mi.Color3f(landing.flux)
    shaded = incident * as_component(landing.turned)
    owner = dr.gather(mi.UInt32, origins.owner, landing.number)
    has_surfaces = dr.grad_enabled(landing.si.p, landing.si.n)
    for index, light in enumerate(origins.lights):
        if not (has_surfaces or has_moving_parts(light.emitter)):
            continue
        lane = mi.UInt32(dr.compress(owner == index))
        if dr.width(lane) == 0:
            continue
        part = _Part(landing, origins, light, lane)
        by_geometry, by_shading = part.follow(landing.si.n), part.follow(landing.si.sh_frame.n)
        turned = dr.gather(mi.Float, landing.turned, lane)
        dr.scatter(incident, by_geometry, lane)
        dr.scatter(shaded, by_shading * as_component(turned), lane)
    return incident, shaded


class _Part:
    """The lit points of one light."""

    def __init__(
        self, landing: Landing, origins: RayOrigins, light: Light, lane: mi.UInt32
    ) -> None:
        self.light, self.lane = light, lane
        ray = dr.gather(mi.UInt32, landing.number, lane)
        self.flux = dr.gather(mi.Color3f, landing.flux, lane)
        self.arriving = dr.gather(mi.Vector3f, landing.direction, lane)
        self.point = dr.gather(mi.Point3f, _along_normal(landing.si), lane)
        self.position = dr.gather(mi.Point2f, origins.position, ray)
        self.direction = dr.gather(mi.Point2f, origins.direction, ray)
        self.share = dr.gather(mi.Float, origins.share, ray)

    def follow(self, normals: mi.Normal3f) -> mi.Color3f:
        """Return the power of the texels, as their irradiance across these normals changes."""
        normal = dr.gather(mi.Vector3f, mi.Vector3f(normals), self.lane)
        emitter = self.light.emitter
        if self.light.is_infinite and not has_moving_parts(emitter):
            cosine = dr.abs(dr.dot(normal, self.arriving))
            return self.flux * as_component(_growth(mi.Float(cosine)))
        if self.light.kind == "AreaLight":
            _, power = emitter.sample_ray(
                as_component(0.0), as_component(0.5), self.position, self.direction
            )
            place, _ = emitter.sample_position(as_component(0.0), self.position)
            between = mi.Vector3f(place.p - self.point)
            squared = dr.squared_norm(between)
            cosines = dr.abs(dr.dot(normal, between) * dr.dot(mi.Vector3f(place.n), between))
            growth = _growth(mi.Float(cosines / dr.square(squared)))
            return mi.Color3f(power) * as_component(self.share * growth)
        it = dr.zeros(mi.SurfaceInteraction3f, dr.width(self.lane))
        it.p = self.point
        sample, irradiance = emitter.sample_direction(it, self.direction)
        arriving = mi.Color3f(irradiance) * as_component(dr.abs(dr.dot(normal, sample.d)))
        # By the light's own values, too, which `flux` has no derivatives by.
        return mi.Color3f(*(self._grown(channel, arriving) for channel in range(3)))

    def _grown(self, channel: int, arriving: mi.Color3f) -> mi.Float:
        """Return a channel of the power, which is all dark where the light's is."""
        return mi.Float(dr.detach(self.flux[channel]) * _growth(mi.Float(arriving[channel])))


def _along_normal(si: mi.SurfaceInteraction3f) -> mi.Point3f:
    """Return points that move along their surface's normal alone."""
    value, normal = dr.detach(si.p), mi.Vector3f(dr.detach(si.n))
    along = dr.dot(normal, mi.Vector3f(si.p - value))
    return mi.Point3f(mi.Vector3f(value) + normal * along)


def _growth(number: mi.Float) -> mi.Float:
    """Return 1, with the derivative of a number over its value, and none where that is 0."""
    value = dr.detach(number)
    is_there = value != 0.0
    return mi.Float(dr.select(is_there, number / dr.select(is_there, value, 1.0), 1.0))
