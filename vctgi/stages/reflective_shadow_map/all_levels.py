"""Light of all emitters for all levels, as injection takes it when nothing has derivatives."""

from __future__ import annotations

import mitsuba as mi

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.scene.lights import Light
from vctgi.scene.records import LightTexels
from vctgi.stages.reflective_shadow_map.config import ReflectiveShadowMapConfig
from vctgi.stages.reflective_shadow_map.distant import distant_rays
from vctgi.stages.reflective_shadow_map.landing import light_all
from vctgi.stages.reflective_shadow_map.maps import light_of_lamps, map_sizes


def trace_all_levels(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    config: ReflectiveShadowMapConfig,
    opacity: OpacityClipmap,
) -> list[LightTexels]:
    """Trace the light of every emitter to where it first lands.

    Parameters
    ----------
    scene, lights, layout, config, opacity
        As for `render_reflective_shadow_maps`.

    Returns
    -------
    list of LightTexels
        Of all finite lights, and of each infinite one for all levels.
    """
    sizes = map_sizes(lights, layout, config)
    found = []
    if sizes.lamps:
        lamp = light_of_lamps(scene, lights, layout, config, sizes)
        found.append(light_all(scene, lamp.rays.ray, lamp.flux, None, lamp.rays.texel))
    for index in sizes.distant:
        rays = distant_rays(scene, lights[index], layout.clip_levels, opacity, sizes.of_distant)
        found.append(light_all(scene, rays.ray, rays.flux, rays.windows, rays.texel, rays.comes))
    return found
