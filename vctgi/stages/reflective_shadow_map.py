"""Reflective shadow maps: where the light of each emitter first lands.

A texel is a ray that leaves the emitter with a share of its power, as Mitsuba's own emitter
sampling gives it, so every emitter that Mitsuba can sample has a map. Lamps inside the scene get
one map each. Light from outside (directional, sky) gets one map for each clip level, aimed at that
level's window, so that its texels are as fine as the voxels that they light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.errors import SceneError
from vctgi.maths.directions import (
    face_forward,
    kronecker_points,
    offset_from_surface,
)
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import half_extent
from vctgi.scene.lights import Light
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.scene.reflectance import hemispherical_albedo

GRAZING_COSINE = 1e-4
"""Texels that hit a surface at a flatter angle carry no light worth dividing by the cosine for."""


@dataclass(frozen=True, kw_only=True)
class ReflectiveShadowMapConfig:
    """Resolution of the maps."""

    texels_per_voxel: float = 8.0
    """Texels along an edge of the map for each voxel along an edge of a level, > 0."""
    max_texel_count: int = 1 << 22
    """Texels of all maps together; more lights than that allows get smaller maps."""

    def __post_init__(self) -> None:
        """Refuse an empty map."""
        if not self.texels_per_voxel > 0.0:
            raise ValueError(
                "ReflectiveShadowMapConfig.texels_per_voxel must be > 0, "
                f"got {self.texels_per_voxel}."
            )
        if self.max_texel_count < 1:
            raise ValueError(
                "ReflectiveShadowMapConfig.max_texel_count must be >= 1, "
                f"got {self.max_texel_count}."
            )


def render_reflective_shadow_maps(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    config: ReflectiveShadowMapConfig,
) -> list[ReflectiveShadowMap]:
    """Trace the light of every emitter to where it first lands.

    Parameters
    ----------
    scene
        Geometry and materials.
    lights
        Emitters to trace.
    layout
        Clipmap that the maps will light; sets their resolution and aim.
    config
        Texels per voxel.

    Returns
    -------
    list of ReflectiveShadowMap
        One for each finite light, one for each clip level and infinite light; none for a light
        that reaches nothing.

    Raises
    ------
    SceneError
        A light whose power is negative, infinite or NaN.

    References
    ----------
    [Dachsbacher2005] C. Dachsbacher, M. Stamminger, Reflective shadow maps.
    """
    map_count = sum(layout.clip_level_count if light.is_infinite else 1 for light in lights)
    edge = _map_edge(layout, config, map_count)
    maps = []
    for light in lights:
        targets = layout.clip_levels if light.is_infinite else (None,)
        for level in targets:
            if level is None:
                ray, flux = _rays_from_lamp(scene, light, edge)
            else:
                ray, flux = _rays_from_outside(scene, light, level, edge)
            _require_power(flux, light.name)
            landed = _land(scene, ray, flux, light.name, None if level is None else level.level)
            if landed is not None:
                maps.append(landed)
    return maps


def _map_edge(layout: ClipmapLayout, config: ReflectiveShadowMapConfig, map_count: int) -> int:
    """Texels along an edge of each map."""
    wanted = math.ceil(config.texels_per_voxel * layout.resolution)
    affordable = math.isqrt(config.max_texel_count // max(map_count, 1))
    if affordable < 1:
        raise ValueError(
            f"render_reflective_shadow_maps: {map_count} maps do not fit "
            f"max_texel_count = {config.max_texel_count}; raise it."
        )
    return min(wanted, affordable)


def _grid(edge: int) -> tuple[mi.UInt32, mi.Point2f]:
    """Texel numbers and the centres of a regular grid of texels."""
    index = dr.arange(mi.UInt32, edge * edge)
    return index, (mi.Point2f(index % edge, index // edge) + 0.5) / edge


def _rays_from_lamp(scene: mi.Scene, light: Light, edge: int) -> tuple[mi.Ray3f, mi.Color3f]:
    """Rays that share the power of a lamp inside the scene, and the power of each, W."""
    index, texel = _grid(edge)
    # The grid goes to the domain that the light really has: directions of a point, positions of a
    # lamp that shines one way; an area light has both, and its directions follow a sequence.
    spread = kronecker_points(index)
    position = spread if light.is_delta_position else texel
    direction = texel if light.is_delta_position else spread
    ray, weight = light.emitter.sample_ray(
        as_component(0.0), as_component(0.5), position, direction
    )
    if light.kind == "AreaLight":
        # Mitsuba starts it at a distance from the lamp that a small scene does not have.
        on_lamp, _ = light.emitter.sample_position(as_component(0.0), position)
        side = face_forward(mi.Vector3f(on_lamp.n), ray.d)
        ray.o = offset_from_surface(on_lamp.p, side, half_extent(scene))
    return ray, mi.Color3f(weight) / (edge * edge)


def _rays_from_outside(
    scene: mi.Scene, light: Light, level: LevelLayout, edge: int
) -> tuple[mi.Ray3f, mi.Color3f]:
    """Rays of a distant light aimed at one window, and the power of each, W.

    Each texel has a direction drawn by the emitter and a place on a disc across that direction
    which covers the part of the scene in the window.
    """
    box = scene.bbox()
    low = np.maximum(np.array(box.min).ravel(), level.window_min)
    high = np.minimum(np.array(box.max).ravel(), level.window_max)
    high = np.maximum(high, low)
    centre = 0.5 * (low + high)
    radius = max(0.5 * float(np.linalg.norm(high - low)), 0.5 * level.voxel_size)
    whole = box.extents()
    # From far enough that nothing of the scene stands behind the disc.
    outside = 2.0 * float(dr.norm(whole)) + radius

    index, texel = _grid(edge)
    it = dr.zeros(mi.SurfaceInteraction3f, dr.width(index))
    it.p = mi.Point3f(*centre.tolist())
    sample, irradiance = light.emitter.sample_direction(it, kronecker_points(index))
    # Light falls from the sampled point on the distant sphere towards the window.
    towards_light = sample.d
    disc = mi.warp.square_to_uniform_disk_concentric(texel) * radius
    frame = mi.Frame3f(towards_light)
    origin = it.p + frame.s * disc.x + frame.t * disc.y + towards_light * outside
    area = math.pi * radius**2
    return mi.Ray3f(origin, -towards_light), mi.Color3f(irradiance) * (area / (edge * edge))


def _require_power(flux: mi.Color3f, name: str) -> None:
    """Refuse a light whose power is no power."""
    is_power = (flux >= 0.0) & dr.isfinite(flux)
    if not bool(dr.all(is_power, axis=None)):
        raise SceneError(
            "its power is negative, infinite or NaN", f"emitter '{name}'", "correct its radiance"
        )


def _land(
    scene: mi.Scene, ray: mi.Ray3f, flux: mi.Color3f, name: str, level: int | None
) -> ReflectiveShadowMap | None:
    """Find what rays hit and how much of their power the surface reflects; None if all miss."""
    is_lit = dr.max(flux) > 0.0
    # First only which rays hit, then the surface of those.
    found = scene.ray_intersect_preliminary(ray, as_mask(True), is_lit)
    dr.eval(found, ray, flux)
    hit = mi.UInt32(dr.compress(found.is_valid() & is_lit))
    if dr.width(hit) == 0:
        return None
    ray = dr.gather(mi.Ray3f, ray, hit)
    flux = dr.gather(mi.Color3f, flux, hit)
    si = dr.gather(type(found), found, hit).compute_surface_interaction(ray)
    normal = mi.Vector3f(si.n)
    cosine = dr.abs(dr.dot(normal, ray.d))
    is_grazing = cosine <= GRAZING_COSINE
    flux = dr.select(is_grazing, 0.0, flux)
    cosine = dr.select(is_grazing, 1.0, cosine)
    # Interpolated normals change the irradiance that Mitsuba's shading sees; so must ours.
    shaded = flux * (dr.abs(mi.Frame3f.cos_theta(si.wi)) / cosine)
    reflected = shaded * hemispherical_albedo(si, dr.arange(mi.UInt32, dr.width(hit)))
    result = ReflectiveShadowMap(
        light_name=name,
        level=level,
        position=si.p,
        normal=face_forward(normal, -ray.d),
        incident_flux=flux,
        reflected_flux=reflected,
    )
    dr.eval(result)
    return result
