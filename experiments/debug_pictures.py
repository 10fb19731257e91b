"""Pictures of the voxels that cones read: for a record, and as a folder beside a frame."""

from __future__ import annotations

import numpy as np

from reports.voxel_colours import QUANTITIES
from reports.voxel_sheet import image_name
from vctgi.clipmap.slots import SlotRule
from vctgi.clipmap.storage import VoxelVolume
from vctgi.debug.camera import PixelRays, pixel_rays
from vctgi.debug.surface_albedo import SAMPLES_PER_FACE, voxel_albedo
from vctgi.debug.voxel_views import VoxelView, view_voxels
from vctgi.debug.voxels import LevelVoxels, stored_voxels
from vctgi.pipeline import PreparedScene


def voxel_images(
    prepared: PreparedScene, volume: VoxelVolume, rule: SlotRule
) -> dict[str, tuple[np.ndarray, str]]:
    """Return what a record keeps of its voxels: name -> (linear picture, description).

    Every clip level as the camera sees it, of the size of the picture, and the lines between voxels
    in a picture of its own, so that the others hold nothing but numbers.
    """
    rays = pixel_rays(prepared.sensor)
    found: dict[str, tuple[np.ndarray, str]] = {}
    for level in range(volume.layout.clip_level_count):
        voxels = stored_voxels(volume, level)
        view = level_view(prepared, voxels, rays, rule)
        title = level_title(voxels)
        for quantity in QUANTITIES:
            found[image_name(level, quantity)] = (getattr(view, quantity), title)
        found[image_name(level, "shade")] = (np.where(view.is_hit, view.shade, 0.0), title)
    return found


def level_view(
    prepared: PreparedScene,
    voxels: LevelVoxels,
    rays: PixelRays,
    rule: SlotRule,
    samples_per_face: float = SAMPLES_PER_FACE,
) -> VoxelView:
    """Return one level as the camera sees it; `rule` says how thick its surfaces were made."""
    albedo = voxel_albedo(prepared.scene, prepared.surfaces, voxels, samples_per_face, rule)
    return view_voxels(voxels, rays, albedo)


def level_title(voxels: LevelVoxels) -> str:
    """Name a level by what a reader can measure."""
    level = voxels.level
    return f"level {level.level}: {level.resolution}^3 voxels of {level.voxel_size:.4g} world units"
