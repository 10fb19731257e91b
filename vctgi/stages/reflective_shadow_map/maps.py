"""One map for all lamps, and one for each clip level and light from outside."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.errors import SceneError
from vctgi.maths.number_rows import start_of_row
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.derivatives import has_moving_shapes
from vctgi.scene.lights import Light
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.reflective_shadow_map.config import ReflectiveShadowMapConfig
from vctgi.stages.reflective_shadow_map.derivative import RayOrigins, anything_moves
from vctgi.stages.reflective_shadow_map.distant import distant_rays
from vctgi.stages.reflective_shadow_map.lamps import (
    LEAST_TEXELS,
    LampRays,
    deal_texels,
    lamp_rays,
    lamp_table,
)
from vctgi.stages.reflective_shadow_map.landing import land


def render_reflective_shadow_maps(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    config: ReflectiveShadowMapConfig,
    opacity: OpacityClipmap | None = None,
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
    opacity
        Voxels of that clipmap: light from outside gets its texels where they show it, and not on
        the undersides of floors. Without them its texels go to all surfaces in a window.

    Returns
    -------
    list of ReflectiveShadowMap
        One for all finite lights, one for each clip level and infinite light; none where no light
        lands.

    Raises
    ------
    SceneError
        A light whose power is negative, infinite or NaN.

    References
    ----------
    [Dachsbacher2005] C. Dachsbacher, M. Stamminger, Reflective shadow maps.
    """
    sizes = map_sizes(lights, layout, config)
    maps = []
    if sizes.lamps:
        maps.append(_light_by_lamps(scene, lights, layout, config, sizes))
    for index in sizes.distant:
        limits = sizes.of_distant
        is_moving = anything_moves([lights[index]])
        with dr.suspend_grad(when=is_moving):  # type: ignore[no-untyped-call]
            rays = distant_rays(scene, lights[index], layout.clip_levels, opacity, limits)
        count = dr.width(rays.ray.o)
        owner = dr.full(mi.UInt32, index, count)
        require_power(rays.flux, owner, lights)
        origins = None
        if is_moving or has_moving_shapes(scene):
            middle = mi.Point2f(dr.full(mi.Float, 0.5, count), 0.5)
            origins = RayOrigins(lights, owner, middle, middle, dr.full(mi.Float, 1.0, count))
        landed = land(scene, rays.ray, rays.flux, rays.windows, rays.texel, origins)
        if landed is not None:
            found, hit = landed
            named = replace(found, light_name=lights[index].name)
            named.light_index = dr.gather(mi.UInt32, owner, hit)
            window = dr.gather(mi.UInt32, rays.windows.number, hit)
            maps += _by_level(named, window, layout)
    kept = [each for each in maps if each is not None]
    dr.eval(kept)
    return kept


@dataclass(frozen=True)
class MapSizes:
    """Which lights have which maps.

    Attributes
    ----------
    lamps, distant
        Places of the finite and the infinite lights in their list.
    of_lamps
        Most texels of one lamp; of all together.
    of_distant
        Texels that should land of a distant light in each level; rays that may be sent for that.
    """

    lamps: list[int]
    distant: list[int]
    of_lamps: tuple[int, int]
    of_distant: tuple[int, int]


def map_sizes(
    lights: list[Light], layout: ClipmapLayout, config: ReflectiveShadowMapConfig
) -> MapSizes:
    """Return how many texels lights get.

    Raises
    ------
    ValueError
        There are more lights than there may be texels.
    """
    lamps = [index for index, light in enumerate(lights) if not light.is_infinite]
    distant = [index for index, light in enumerate(lights) if light.is_infinite]
    wanted = math.ceil(config.texels_per_voxel * layout.resolution) ** 2
    affordable = _affordable(len(lamps) + layout.read_clip_level_count * len(distant), config)
    most = min(affordable * len(lamps), wanted * config.full_lamp_count)
    of_distant = (min(wanted, affordable), affordable)
    return MapSizes(lamps, distant, (min(wanted, most), most), of_distant)


def _by_level(
    rsm: ReflectiveShadowMap, window: mi.UInt32, layout: ClipmapLayout
) -> list[ReflectiveShadowMap]:
    """Return the part of a map that each clip level has, from the window of each texel.

    Texels of one window stand side by side, in the order of the levels.
    """
    counts = dr.zeros(mi.UInt32, layout.clip_level_count)
    dr.scatter_reduce(dr.ReduceOp.Add, counts, mi.UInt32(1), window)
    dr.eval(rsm, counts)
    parts, begin = [], 0
    for level, count in zip(layout.clip_levels, np.array(counts).tolist(), strict=True):
        if count:
            index = dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, begin)
            parts.append(replace(_texels(rsm, index), level=level.level))
        begin += count
    return parts


def _texels(rsm: ReflectiveShadowMap, index: mi.UInt32) -> ReflectiveShadowMap:
    """Return some texels of a map."""
    assert rsm.light_index is not None, "maps are made of lights"
    return ReflectiveShadowMap(
        light_name=rsm.light_name,
        level=rsm.level,
        position=dr.gather(mi.Point3f, rsm.position, index),
        normal=dr.gather(mi.Vector3f, rsm.normal, index),
        incident_flux=dr.gather(mi.Color3f, rsm.incident_flux, index),
        reflected_flux=dr.gather(mi.Color3f, rsm.reflected_flux, index),
        light_index=dr.gather(mi.UInt32, rsm.light_index, index),
    )


def _affordable(map_count: int, config: ReflectiveShadowMapConfig) -> int:
    """Texels of each map, if all were as large as allowed."""
    affordable = config.max_texel_count // max(map_count, 1)
    if affordable < LEAST_TEXELS:
        raise ValueError(
            f"render_reflective_shadow_maps: {map_count} maps of at least {LEAST_TEXELS} texels do "
            f"not fit max_texel_count = {config.max_texel_count}; raise it."
        )
    return affordable


@dataclass
class LampLight:
    """Rays of all lamps, the power of each, W, and the place of its light among all lights."""

    rays: LampRays
    flux: mi.Color3f
    owner: mi.UInt32
    texel_count: mi.UInt32


def light_of_lamps(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    config: ReflectiveShadowMapConfig,
    sizes: MapSizes,
) -> LampLight:
    """Return the rays of all lamps; what they were made from has no derivatives."""
    chosen = [lights[index] for index in sizes.lamps]
    counts = deal_texels(scene, chosen, layout, config.texels_per_face, sizes.of_lamps)
    rays = lamp_rays(scene, chosen, counts, layout)
    table, start = lamp_table([*counts.tolist(), *sizes.lamps]), start_of_row()
    texel_count = dr.gather(mi.UInt32, table, rays.which + start)
    flux = rays.weight / as_component(mi.Float(texel_count))
    owner = dr.gather(mi.UInt32, table, rays.which + (start + len(chosen)))
    return LampLight(rays, flux, owner, texel_count)


def _light_by_lamps(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    config: ReflectiveShadowMapConfig,
    sizes: MapSizes,
) -> ReflectiveShadowMap | None:
    """Trace all lamps in one launch; None if none of them reaches anything."""
    is_followed = anything_moves(lights) or has_moving_shapes(scene)
    with dr.suspend_grad(when=is_followed):  # type: ignore[no-untyped-call]
        lamp = light_of_lamps(scene, lights, layout, config, sizes)
    rays, owner = lamp.rays, lamp.owner
    require_power(lamp.flux, owner, lights)
    origins = None
    if is_followed:
        share = 1.0 / mi.Float(lamp.texel_count)
        origins = RayOrigins(lights, owner, rays.position, rays.direction, share)
    landed = land(scene, rays.ray, lamp.flux, None, rays.texel, origins)
    if landed is None:
        return None
    found, hit = landed
    count = len(sizes.lamps)
    name = lights[sizes.lamps[0]].name if count == 1 else f"{count} lamps"
    return replace(found, light_name=name, light_index=dr.gather(mi.UInt32, owner, hit))


def require_power(flux: mi.Color3f, owner: mi.UInt32, lights: list[Light]) -> None:
    """Refuse a light whose power is no power.

    Raises
    ------
    SceneError
        It names the first such light.
    """
    is_power = dr.all((flux >= 0.0) & dr.isfinite(flux))
    if bool(dr.all(is_power)):
        return
    first = int(np.min(np.array(dr.gather(mi.UInt32, owner, mi.UInt32(dr.compress(~is_power))))))
    raise SceneError(
        "its power is negative, infinite or NaN",
        f"emitter '{lights[first].name}'",
        "correct its radiance",
    )
