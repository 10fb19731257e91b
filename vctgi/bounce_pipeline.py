"""The order of the stages that light voxels by cones of their own, and nothing else.

opacity, scene -> slot surfaces
emittance -> downsampling -> diffuse cones of the slots -> bounces = emittance of more scatterings
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slot_surfaces import SlotSurfaces
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, pack_volume
from vctgi.config import RenderConfig
from vctgi.scene.sky import PrefilteredSky
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.bounces import Gather, add_light, bounce_light, reflect, slot_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.downsampling import downsample
from vctgi.stages.slot_surfaces.slots import describe_slots


def light_by_cones(
    scene: mi.Scene,
    voxelized: VoxelSurfaces,
    opacity: OpacityClipmap,
    injected: EmittanceClipmap,
    config: RenderConfig,
    sky: PrefilteredSky | None,
    clock: Callable[[str], AbstractContextManager[object]],
) -> tuple[EmittanceClipmap, list[float]]:
    """Add the light that voxels gather by cones of their own: of the sky, and of other voxels.

    Parameters
    ----------
    scene, voxelized
        Geometry with its materials, and its sides that are voxelized.
    opacity, injected
        Opacity, and light after one scattering, at each clip level's own resolution.
    config
        Which of both, how many bounces, by which cones.
    sky
        What lights the voxels if `config.sky_lighting` says so; None where there is no sky.
    clock
        Times the stages.

    Returns
    -------
    tuple
        Emittance of all scatterings, and the flux that the voxels emit after each of them, W.
    """
    with clock("slot surfaces"):
        surfaces = describe_slots(scene, voxelized, opacity, config.slot_surfaces)
    if config.sky_lighting == "cones" and sky is not None:
        with clock("sky on voxels"):
            gather = slot_gatherer(scene, surfaces, opacity, config, sky)
            dark = reflect(injected, [], [])
            injected = add_light(injected, reflect(injected, surfaces, gather(dark)))
    with clock("bounces"):
        gather = slot_gatherer(scene, surfaces, opacity, config)
        bounced = bounce_light(injected, surfaces, gather, config.bounce_count, config.bounces)
    return bounced.emittance, bounced.fluxes


def slot_gatherer(
    scene: mi.Scene,
    surfaces: list[SlotSurfaces],
    opacity: OpacityClipmap,
    config: RenderConfig,
    sky: PrefilteredSky | None = None,
) -> Gather:
    """Return what brings the light of voxels, and of a sky if there is one, to slots by cones."""
    receivers = [slot_receivers(each) if each.count else None for each in surfaces]

    def gather(emittance: EmittanceClipmap) -> list[mi.Color3f]:
        merged, lit = downsample(opacity, emittance, config.downsampling)
        assert lit is not None, "downsampling keeps the emittance it is given"
        volume = pack_volume(merged, lit, config.storage)
        return [
            dr.zeros(mi.Color3f, 0)
            if each is None
            else trace_diffuse(each, volume, config.bounce_cones, scene, sky)
            for each in receivers
        ]

    return gather
