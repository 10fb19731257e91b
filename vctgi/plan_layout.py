"""Where the clipmap of a scene lies, and how many levels it needs."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import WINDOW_MARGIN_VOXELS, ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import bytes_per_voxel
from vctgi.config import RenderConfig
from vctgi.plan_entries import PlanEntry, needed_entry
from vctgi.scene.camera import survey_rays, viewer
from vctgi.scene.triangles import SceneTriangles

SURVEY_RESOLUTION = 64
"""Camera rays along an edge of the picture that the clipmap is fitted to."""

NEAR_SHARE = 0.8
"""Share of the visible points, nearest first, that the finest level holds."""

MAX_FAR_RATIO = 1e4
"""Largest scene extent over finest level extent that is worth a level of its own."""


def choose_layout(
    scene: mi.Scene, sensor: mi.Sensor, triangles: SceneTriangles, config: RenderConfig
) -> tuple[ClipmapLayout, list[PlanEntry]]:
    """Fit the finest level to what the camera sees nearby, and add levels until all is held."""
    clipmap = config.clipmap
    low, high = triangles.bounds
    near_low, near_high = _near_bounds(scene, sensor, low, high)
    usable = clipmap.resolution - 2.0 * WINDOW_MARGIN_VOXELS
    smallest = float(np.max(high - low)) / MAX_FAR_RATIO
    voxel_size = clipmap.finest_voxel_size or (
        max(float(np.max(near_high - near_low)), smallest) / usable
    )
    middle = 0.5 * (near_low + near_high)
    if clipmap.ahead is not None:
        position, forward = viewer(sensor)
        middle = position + clipmap.ahead * 0.5 * clipmap.resolution * voxel_size * forward
    x, y, z = middle.tolist()
    centre = clipmap.centre or (x, y, z)

    def lay_out(level_count: int, spare: int = 0) -> ClipmapLayout:
        return lay_out_clipmap(
            centre,
            finest_voxel_size=voxel_size,
            level_count=level_count + spare,
            resolution=clipmap.resolution,
            spare_level_count=spare,
        )

    counts = [clipmap.level_count] if clipmap.level_count else range(1, clipmap.max_level_count + 1)
    layouts = [lay_out(count) for count in counts]
    layout = next((each for each in layouts if _holds(each, low, high)), layouts[-1])
    left_out = 0 if clipmap.level_count else clipmap.max_level_count - layout.clip_level_count
    reason = f"finest voxel {voxel_size:.4g}, coarsest window {layout.extent:.4g} world units"
    entries = [PlanEntry(item=f"{layout.clip_level_count} clip levels", kept=True, reason=reason)]
    if not _holds(layout, low, high):
        entries.append(
            PlanEntry(
                item="geometry outside the coarsest window",
                kept=False,
                reason=f"the scene extends over {float(np.max(high - low)):.4g} world units; "
                "raise clipmap.max_level_count to hold it",
                saved="further levels",
                override="clipmap.max_level_count",
            )
        )
    elif left_out > 0:
        count = left_out * clipmap.resolution**3
        if config.is_kept("levels"):
            layout = lay_out(layout.clip_level_count, left_out)
        entries.append(
            needed_entry(
                "levels",
                config,
                item=f"{left_out} further clip levels",
                needs="",
                lacks="the coarsest window holds the whole scene",
                saved=f"{count:,} voxels, up to {count * bytes_per_voxel(config.storage):,} bytes",
            )
        )
    return layout, entries


def _near_bounds(
    scene: mi.Scene, sensor: mi.Sensor, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the nearest visible points, or of the scene where none is visible."""
    si = scene.ray_intersect(survey_rays(sensor, SURVEY_RESOLUTION))
    is_hit = np.array(si.is_valid())
    if not is_hit.any():
        return low, high
    points = np.array(si.p, dtype=np.float64).T[is_hit]
    depth = np.array(si.t, dtype=np.float64)[is_hit]
    near = points[depth <= np.quantile(depth, NEAR_SHARE)]
    return near.min(axis=0), near.max(axis=0)


def _holds(layout: ClipmapLayout, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether the coarsest window holds a box."""
    box = layout.coarsest
    return bool(np.all(low >= box.window_min) and np.all(high <= box.window_max))
