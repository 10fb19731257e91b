"""One map for all lamps, and one for each clip level and light from outside."""

from __future__ import annotations

import math
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.errors import SceneError
from vctgi.maths.recording import Recorder
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.derivatives import has_moving_shapes
from vctgi.scene.lights import Light
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.reflective_shadow_map.config import ReflectiveShadowMapConfig
from vctgi.stages.reflective_shadow_map.derivative import RayOrigins, anything_moves
from vctgi.stages.reflective_shadow_map.distant import distant_rays
from vctgi.stages.reflective_shadow_map.lamps import (
    LEAST_TEXELS,
    deal_texels,
    lamp_rays,
    lamp_table,
)
from vctgi.stages.reflective_shadow_map.landing import find_landings, light_landings


def render_reflective_shadow_maps(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    config: ReflectiveShadowMapConfig,
    opacity: OpacityClipmap | None = None,
    recorder: Recorder | None = None,
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
    recorder
        Keeps what is traced; not for what has derivatives.

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
    lamps = [index for index, light in enumerate(lights) if not light.is_infinite]
    distant = [index for index, light in enumerate(lights) if light.is_infinite]
    wanted = math.ceil(config.texels_per_voxel * layout.resolution) ** 2
    affordable = _affordable(len(lamps) + layout.read_clip_level_count * len(distant), config)
    maps = []
    if lamps:
        most = min(affordable * len(lamps), wanted * config.full_lamp_count)
        full = min(wanted, most)
        maps.append(_light_by_lamps(scene, lights, lamps, layout, (config, full, most), recorder))
    for index in distant:
        limits = (min(wanted, affordable), affordable)
        is_moving = anything_moves([lights[index]])
        is_followed = is_moving or has_moving_shapes(scene)
        keeper = None if is_followed else recorder
        with dr.suspend_grad(when=is_moving):  # type: ignore[no-untyped-call]
            rays = distant_rays(scene, lights[index], layout.clip_levels, opacity, limits, keeper)
        count = dr.width(rays.texel)
        owner = dr.full(mi.UInt32, index, count)
        require_power(rays.landings.is_power, owner, lights)
        origins = None
        if is_followed:
            middle = mi.Point2f(dr.full(mi.Float, 0.5, count), 0.5)
            origins = RayOrigins(lights, owner, middle, middle, dr.full(mi.Float, 1.0, count))
        landed = light_landings(scene, rays.landings, rays.texel, origins, keeper)
        if landed is not None:
            found, hit = landed
            named = replace(found, light_name=lights[index].name)
            named.light_index = dr.gather(mi.UInt32, owner, hit)
            window = dr.gather(mi.UInt32, rays.window, hit)
            maps += _by_level(named, window, layout)
    kept = [each for each in maps if each is not None]
    dr.eval(kept)
    return kept


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


def _light_by_lamps(
    scene: mi.Scene,
    lights: list[Light],
    lamps: list[int],
    layout: ClipmapLayout,
    limits: tuple[ReflectiveShadowMapConfig, int, int],
    recorder: Recorder | None,
) -> ReflectiveShadowMap | None:
    """Trace all lamps in one launch; None if none of them reaches anything."""
    chosen = [lights[index] for index in lamps]
    config, full, most = limits
    counts = deal_texels(scene, chosen, layout, config.texels_per_face, (full, most))
    is_followed = anything_moves(lights) or has_moving_shapes(scene)
    with dr.suspend_grad(when=is_followed):  # type: ignore[no-untyped-call]
        rays = lamp_rays(scene, chosen, counts, layout)
    which = rays.which
    texel_count = dr.gather(mi.UInt32, lamp_table(counts.tolist()), which)
    flux = rays.weight / as_component(mi.Float(texel_count))
    owner = dr.gather(mi.UInt32, lamp_table(lamps), which)
    landings = find_landings(scene, rays.ray, flux, None)
    require_power(landings.is_power, owner, lights)
    origins = None
    if is_followed:
        share = 1.0 / mi.Float(texel_count)
        origins = RayOrigins(lights, owner, rays.position, rays.direction, share)
    keeper = None if is_followed else recorder
    landed = light_landings(scene, landings, rays.texel, origins, keeper)
    if landed is None:
        return None
    found, hit = landed
    name = chosen[0].name if len(chosen) == 1 else f"{len(chosen)} lamps"
    return replace(found, light_name=name, light_index=dr.gather(mi.UInt32, owner, hit))


def require_power(is_power: mi.Bool, owner: mi.UInt32, lights: list[Light]) -> None:
    """Refuse a light whose power is no power.

    Parameters
    ----------
    is_power
        Whether that of each ray is one.
    owner
        Place of each ray's light in the list.
    lights
        All of them.

    Raises
    ------
    SceneError
        It names the first such light.
    """
    if bool(dr.all(is_power)):
        return
    first = int(np.min(np.array(dr.gather(mi.UInt32, owner, mi.UInt32(dr.compress(~is_power))))))
    raise SceneError(
        "its power is negative, infinite or NaN",
        f"emitter '{lights[first].name}'",
        "correct its radiance",
    )
