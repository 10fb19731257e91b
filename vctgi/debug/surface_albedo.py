"""The albedo that voxels hold, as the bounces of light know it, for pictures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slots import DEFAULT_RULE, SlotRule
from vctgi.debug.voxels import LevelVoxels
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.slot_surfaces.samples import SAMPLES_PER_FACE as SAMPLES_PER_FACE
from vctgi.stages.slot_surfaces.samples import shade_surfaces
from vctgi.stages.slot_surfaces.slots import sum_in_slots


@dataclass
class VoxelAlbedo:
    """Light that the slots of one level reflect, flat [direction, z, y, x].

    Attributes
    ----------
    reflected
        Reflected by the surfaces themselves.
    white
        Reflected if they were white: the weight of the samples in each slot.
    """

    reflected: mi.Color3f
    white: mi.Float

    def sampled_in(self, voxels: LevelVoxels) -> LevelVoxels:
        """Return `voxels` with the weight of the samples in the place of opacity."""
        return replace(voxels, opacity=self.white)


def voxel_albedo(
    scene: mi.Scene,
    surfaces: VoxelSurfaces,
    voxels: LevelVoxels,
    samples_per_face: float = SAMPLES_PER_FACE,
    rule: SlotRule = DEFAULT_RULE,
) -> VoxelAlbedo:
    """Return the albedo of the voxels of one level.

    Parameters
    ----------
    scene, surfaces
        Geometry with its materials, and its sides that are voxelized.
    voxels
        The level; only slots with opacity hold anything.
    samples_per_face
        Points on a surface as large as a voxel's face, > 0.
    rule
        How thick the surfaces were made.
    """
    window = voxels.level
    white = dr.zeros(mi.Float, DIRECTION_COUNT * window.voxel_count)
    reflected = dr.zeros(mi.Color3f, dr.width(white))
    index = mi.UInt32(dr.compress(voxels.opacity > 0.0))
    if dr.width(index):
        samples = shade_surfaces(scene, surfaces.vertices, window, samples_per_face)
        sums = sum_in_slots(samples, index, window, rule)
        dr.scatter(white, sums.covered, index)
        dr.scatter(reflected, sums.reflected, index)
        dr.eval(white, reflected)
    return VoxelAlbedo(reflected, white)
