"""Light of all emitters for all levels, as injection takes it when nothing has derivatives."""

from __future__ import annotations

from itertools import accumulate

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.clipmap.regions import intersection, own_regions, world_region
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.number_rows import entry
from vctgi.maths.recording import Recorder, run_recorded
from vctgi.scene.extent import scene_bounds
from vctgi.scene.lights import Light
from vctgi.scene.records import LightTexels
from vctgi.stages.reflective_shadow_map.config import ReflectiveShadowMapConfig
from vctgi.stages.reflective_shadow_map.distant import Cells
from vctgi.stages.reflective_shadow_map.kept import KeptLight
from vctgi.stages.reflective_shadow_map.landing import Windows, light_all
from vctgi.stages.reflective_shadow_map.maps import light_of_lamps, map_sizes


def trace_all_levels(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    config: ReflectiveShadowMapConfig,
    opacity: OpacityClipmap,
    plain: mi.UInt32,
    kept: KeptLight | None = None,
    recorder: Recorder | None = None,
) -> list[LightTexels]:
    """Trace the light of every emitter to where it first lands.

    Parameters
    ----------
    scene, lights, layout, config, opacity
        As for `render_reflective_shadow_maps`.
    plain
        What `list_plain_bsdfs` returned for the scene.
    kept
        What earlier calls found of light from outside, which then is not looked for again; gets
        what this one finds. None: nothing is kept.
    recorder
        Keeps what is traced; None: nobody does.

    Returns
    -------
    list of LightTexels
        Of all finite lights, and of each infinite one for all levels, or for each that was kept.
    """
    sizes = map_sizes(lights, layout, config)
    found = []
    if sizes.lamps:
        lamp = light_of_lamps(scene, lights, layout, config, sizes)
        rays = (lamp.rays.ray, lamp.flux, lamp.rays.texel)
        if recorder is not None:
            dr.eval(rays)
        found.append(run_recorded(recorder, "light of lamps", light_all, scene, *rays, plain))
    levels = _levels_with_surfaces(scene, layout, opacity) if sizes.distant else []
    same = set()
    if kept is not None and sizes.distant:
        same = kept.compare(scene, lights, opacity, sizes)
    for index in sizes.distant:
        held = {} if kept is None else kept.texels
        stale = [each for each in levels if (index, each.level) not in held]
        if stale:
            most = layout.clip_level_count
            cells = Cells(scene, lights[index], stale, sizes.of_distant, most)
            texels, counts = _light_distant(scene, cells, opacity, plain, recorder)
            if kept is None or index not in same or dr.grad_enabled(texels):
                # A light that changes from frame to frame is not worth parting by levels.
                found.append(texels)
                continue
            numbers = [index * layout.clip_level_count + level.level for level in stale]
            parts = _parts(texels, counts, numbers)
            for level, part in zip(stale, parts, strict=True):
                kept.texels[index, level.level] = part
        found += [held[index, level.level] for level in levels]
    return found


def _levels_with_surfaces(
    scene: mi.Scene, layout: ClipmapLayout, opacity: OpacityClipmap
) -> list[LevelLayout]:
    """Return the clip levels in which a surface may fill a voxel of their own.

    Where finer windows hold the whole scene, no light could be seen in the coarser one.
    """
    low, high = scene_bounds(scene)
    # One voxel more than surfaces reach, for rounding.
    reach = opacity.rule.reach_voxels + 1.0
    found = []
    for level in layout.clip_levels:
        box = world_region(level, low, high, reach)
        parts = [] if box is None else own_regions(layout, level)
        if any(box is not None and intersection(part, box) is not None for part in parts):
            found.append(level)
    return found


def _light_distant(
    scene: mi.Scene,
    cells: Cells,
    opacity: OpacityClipmap,
    plain: mi.UInt32,
    recorder: Recorder | None,
) -> tuple[LightTexels, list[int]]:
    """Return what a light from outside lights, and rays of each window."""
    dealt, counts = cells.deal(scene, opacity, recorder)
    lane, starts = cells.lanes_of(counts)

    def light(
        scene: mi.Scene,
        plain: mi.UInt32,
        windows: Windows,
        dealt: mi.UInt32,
        lane: mi.UInt32,
        starts: mi.Int32,
    ) -> LightTexels:
        rays = cells.rays(windows, dealt, lane, starts)
        aim = (rays.windows, rays.comes)
        return light_all(scene, rays.ray, rays.flux, rays.texel, plain, aim)

    if recorder is not None:
        dr.make_opaque(dealt, lane)
    key = ("light from outside", cells.key)
    inputs = (scene, plain, cells.windows, dealt, lane, starts)
    return run_recorded(recorder, key, light, *inputs), counts


def _parts(texels: LightTexels, counts: list[int], numbers: list[int]) -> list[LightTexels]:
    """Return the texels of each window, which stand side by side, and dark ones after them.

    Each part has as many dark ones as its number says, which no other part has: recordings tell
    apart which of their inputs are of equal width, and windows often have as many rays.
    """
    starts = mi.Int32([0, *accumulate(counts)])
    parts = []
    for place, (count, number) in enumerate(zip(counts, numbers, strict=True)):
        first, after = (mi.UInt32(entry(starts, each)) for each in (place, place + 1))
        index = dr.arange(mi.UInt32, count + number) + first
        is_own = index < after
        assert texels.level is not None, "only light from outside is parted"
        part = LightTexels(
            position=dr.gather(mi.Point3f, texels.position, index, is_own),
            normal=dr.gather(mi.Vector3f, texels.normal, index, is_own),
            reflected_flux=dr.gather(mi.Color3f, texels.reflected_flux, index, is_own),
            is_lit=dr.gather(mi.Bool, texels.is_lit, index, is_own),
            largest=dr.gather(mi.Float, texels.largest, index, is_own),
            level=dr.gather(mi.UInt32, texels.level, index, is_own),
        )
        # One after the other, so that the kernel is the same however many there are.
        dr.eval(part)
        parts.append(part)
    return parts
