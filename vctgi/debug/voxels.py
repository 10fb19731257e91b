"""The voxels that the stages write, and those of one level taken out of them.

A volume packed for reading may have lost digits or directions; what is shown here is what the
stages made of the scene, before it is packed.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.config import RenderConfig
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.pipeline import PreparedScene
from vctgi.stages.downsampling import downsample
from vctgi.stages.light_injection import inject_light
from vctgi.stages.reflective_shadow_map import render_reflective_shadow_maps
from vctgi.stages.voxelization.opacity import voxelize_opacity


@dataclass
class SceneVoxels:
    """All voxels of a scene.

    Attributes
    ----------
    direct_opacity
        Every clip level voxelized at its own resolution.
    opacity, emittance
        What cones read: coarser levels made by downsampling where a finer one covers them.
    """

    direct_opacity: OpacityClipmap
    opacity: OpacityClipmap
    emittance: EmittanceClipmap


@dataclass
class LevelVoxels:
    """Opacity and emittance of one level.

    Attributes
    ----------
    level
        Where the level lies.
    opacity
        Flat [direction, z, y, x], in [0, 1], texels at their toroidal address.
    emittance
        The same form, W m^-2 sr^-1, premultiplied by opacity.
    """

    level: LevelLayout
    opacity: mi.Float
    emittance: mi.Color3f


def scene_voxels(prepared: PreparedScene, config: RenderConfig) -> SceneVoxels:
    """Voxelize and light a scene as the renderer does."""
    layout = prepared.plan.layout
    direct = voxelize_opacity(prepared.surfaces, layout)
    maps = render_reflective_shadow_maps(
        prepared.scene, list(prepared.plan.lights), layout, config.reflective_shadow_map
    )
    opacity, emittance = downsample(direct, inject_light(maps, direct))
    assert emittance is not None, "downsampling keeps the emittance it is given"
    return SceneVoxels(direct, opacity, emittance)


def level_voxels(
    opacity: OpacityClipmap, level: int, emittance: EmittanceClipmap | None = None
) -> LevelVoxels:
    """Return the voxels of one level of clipmaps; dark ones where no emittance is given."""
    layout = opacity.layout.levels[level]
    if emittance is None:
        dark = dr.zeros(mi.Color3f, DIRECTION_COUNT * layout.voxel_count)
        return LevelVoxels(layout, opacity.levels[level], dark)
    assert opacity.layout == emittance.layout, "opacity and emittance must share one layout"
    return LevelVoxels(layout, opacity.levels[level], emittance.levels[level])
