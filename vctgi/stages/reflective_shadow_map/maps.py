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
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.derivatives import has_moving_shapes
from vctgi.scene.lights import Light
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.reflective_shadow_map.config import ReflectiveShadowMapConfig
from vctgi.stages.reflective_shadow_map.derivative import RayOrigins, anything_moves
from vctgi.stages.reflective_shadow_map.distant import distant_rays
from vctgi.stages.reflective_shadow_map.lamps import LEAST_TEXELS, deal_texels, lamp_rays
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
    lamps = [index for index, light in enumerate(lights) if not light.is_infinite]
    distant = [index for index, light in enumerate(lights) if light.is_infinite]
    wanted = math.ceil(config.texels_per_voxel * layout.resolution) ** 2
    affordable = _affordable(len(lamps) + layout.clip_level_count * len(distant), config)
    maps = []
    if lamps:
        most = min(affordable * len(lamps), wanted * config.full_lamp_count)
        full = min(wanted, most)
        maps.append(_light_by_lamps(scene, lights, lamps, layout, (config, full, most)))
    for index in distant:
        for level in layout.clip_levels:
            limits = (min(wanted, affordable), affordable)
            is_followed = anything_moves([lights[index]]) or has_moving_shapes(scene)
            with dr.suspend_grad(when=anything_moves([lights[index]])):  # type: ignore[no-untyped-call]
                ray, flux = distant_rays(scene, lights[index], level, opacity, limits)
            count = dr.width(ray.o)
            owner = dr.full(mi.UInt32, index, count)
            require_power(flux, owner, lights)
            origins = None
            if is_followed:
                middle = mi.Point2f(dr.full(mi.Float, 0.5, count), 0.5)
                origins = RayOrigins(lights, owner, middle, middle, dr.full(mi.Float, 1.0, count))
            landed = land(scene, ray, flux, level, dr.arange(mi.UInt32, count), origins)
            if landed is not None:
                found, hit = landed
                owner = dr.gather(mi.UInt32, owner, hit)
                maps.append(replace(found, light_name=lights[index].name, light_index=owner))
    kept = [each for each in maps if each is not None]
    dr.eval(kept)
    return kept


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
) -> ReflectiveShadowMap | None:
    """Trace all lamps in one launch; None if none of them reaches anything."""
    chosen = [lights[index] for index in lamps]
    config, full, most = limits
    counts = deal_texels(scene, chosen, layout, config.texels_per_face, (full, most))
    is_followed = anything_moves(lights) or has_moving_shapes(scene)
    with dr.suspend_grad(when=is_followed):  # type: ignore[no-untyped-call]
        rays = lamp_rays(scene, chosen, counts, layout)
    which = rays.which
    texel_count = dr.gather(mi.UInt32, mi.UInt32(counts.astype(np.uint32)), which)
    flux = rays.weight / as_component(mi.Float(texel_count))
    owner = dr.gather(mi.UInt32, mi.UInt32(np.array(lamps, dtype=np.uint32)), which)
    require_power(flux, owner, lights)
    origins = None
    if is_followed:
        share = 1.0 / mi.Float(texel_count)
        origins = RayOrigins(lights, owner, rays.position, rays.direction, share)
    landed = land(scene, rays.ray, flux, None, rays.texel, origins)
    if landed is None:
        return None
    found, hit = landed
    name = chosen[0].name if len(chosen) == 1 else f"{len(chosen)} lamps"
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
