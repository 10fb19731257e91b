"""The voxels of one level: those that cones read, or those that a stage wrote."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume
from vctgi.clipmap.unpacking import unpack_level
from vctgi.maths.directions import DIRECTION_COUNT


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


def stored_voxels(volume: VoxelVolume, level: int) -> LevelVoxels:
    """Return the voxels of one level as cones read them, after storage in whatever format."""
    layout = volume.layout.levels[level]
    texels = unpack_level(volume, layout)
    return LevelVoxels(layout, texels.opacity, texels.emittance)


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
