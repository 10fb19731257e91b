"""The order of the stages that light voxels by cones of their own, and nothing else.

opacity, scene -> slot surfaces
emittance -> downsampling -> diffuse cones of the slots -> bounces = emittance of more scatterings
"""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slot_surfaces import SlotSurfaces
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.clipmap.stored_directions import StoredDirections
from vctgi.config import RenderConfig
from vctgi.prepared import PreparedScene, StageClock
from vctgi.scene.sky import PrefilteredSky
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.bounces import (
    BouncedLight,
    Gather,
    add_light,
    bounce_light,
    reflect,
    slot_receivers,
)
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.downsampling import downsample_volume
from vctgi.stages.slot_surfaces.slots import describe_slots


def light_by_cones(
    prepared: PreparedScene,
    voxelized: VoxelSurfaces,
    opacity: OpacityClipmap,
    injected: EmittanceClipmap,
    config: RenderConfig,
    clock: StageClock,
) -> BouncedLight:
    """Add the light that voxels gather by cones of their own: of the sky, and of other voxels.

    Parameters
    ----------
    prepared, voxelized
        The scene, and its sides that are voxelized.
    opacity, injected
        Opacity, and light after one scattering, at each clip level's own resolution.
    config
        Which of both, how many bounces, by which cones.
    clock
        Times the stages.

    Returns
    -------
    BouncedLight
        Emittance of all scatterings, and what the voxels emit after each of them.
    """
    scene, stored, is_live = prepared.scene, prepared.plan.directions, prepared.has_derivatives
    with clock("slot surfaces"):
        surfaces = describe_slots(scene, voxelized, opacity, config.slot_surfaces)
    if prepared.plan.has_sky_by_cones:
        with clock("sky on voxels"):
            gather = slot_gatherer(
                scene, surfaces, opacity, config, stored, prepared.sky, has_derivatives=is_live
            )
            dark = reflect(injected, [], [])
            injected = add_light(injected, reflect(injected, surfaces, gather(dark)))
    with clock("bounces"):
        gather = slot_gatherer(scene, surfaces, opacity, config, stored, has_derivatives=is_live)
        ends = config.bounces
        if config.is_kept("bounces"):
            ends = replace(ends, min_bounce_share=0.0)
        return bounce_light(injected, surfaces, gather, config.bounce_count, ends)


def slot_gatherer(
    scene: mi.Scene,
    surfaces: list[SlotSurfaces],
    opacity: OpacityClipmap,
    config: RenderConfig,
    directions: StoredDirections | None = None,
    sky: PrefilteredSky | None = None,
    *,
    has_derivatives: bool = False,
) -> Gather:
    """Return what brings the light of voxels, and of a sky if there is one, to slots by cones.

    Parameters
    ----------
    scene, surfaces, opacity
        Geometry, the surfaces behind the slots, and how opaque those are.
    config
        Cones and storage.
    directions
        Which of the voxels' directions are stored; None: as many as the storage says.
    sky
        What cones see beyond the voxels; None: darkness.
    has_derivatives
        Whether derivatives of what cones see are wanted.
    """
    receivers = [slot_receivers(each) if each.count else None for each in surfaces]

    def gather(emittance: EmittanceClipmap) -> list[mi.Color3f]:
        volume = downsample_volume(
            opacity,
            emittance,
            config.downsampling,
            config.storage,
            directions,
            keeps_empty=config.is_kept("levels"),
            has_derivatives=has_derivatives,
        )
        return [
            dr.zeros(mi.Color3f, 0)
            if each is None
            else trace_diffuse(each, volume, config.bounce_cones, scene, sky)
            for each in receivers
        ]

    return gather
