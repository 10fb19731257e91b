"""Which of the six directions of a voxel hold anything, by the surfaces that are voxelized."""

from __future__ import annotations

import numpy as np

from vctgi.clipmap.stored_directions import SAME, SIX, StoredDirections, facing_directions
from vctgi.config import RenderConfig
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.plan_entries import PlanEntry, left_out_entry
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.voxelization.triangles import unit_normals

NAMES = ("+x", "-x", "+y", "-y", "+z", "-z")


def choose_directions(
    surfaces: VoxelSurfaces, config: RenderConfig
) -> tuple[StoredDirections | None, list[PlanEntry]]:
    """Leave out directions of travel that meet no surface from its front.

    A slot is written by surfaces that face its direction, and mips are made of finer slots of the
    same one, so what no surface faces is zero at every level. Rules that spread one side's opacity
    over others are excepted; of those, the one that makes all six alike leaves five out.

    Parameters
    ----------
    surfaces
        Sides that are voxelized.
    config
        What is asked for.

    Returns
    -------
    tuple
        What is stored, None where the storage says so itself; what to say of it.
    """
    item = "directions of voxels"
    if config.storage.direction_count != DIRECTION_COUNT:
        reason = f"storage.direction_count = {config.storage.direction_count}"
        return None, [PlanEntry(item=item, kept=True, reason=reason)]
    if config.is_kept("directions"):
        return None, [PlanEntry(item=item, kept=True, reason="all six, by keep directions")]
    if config.downsampling.is_isotropic and config.downsampling.mips == "average":
        entry = left_out_entry(
            "directions",
            item="five of six directions",
            reason="voxels that look the same from all sides",
            saved="five slots of six",
        )
        return SAME, [entry]
    spreads = config.downsampling.is_isotropic or config.voxelization.is_two_sided
    if spreads or config.emission_in_voxels:
        return SIX, [PlanEntry(item=item, kept=True, reason="surfaces are seen from all sides")]
    faced = faced_directions(surfaces)
    empty = [name for name, is_faced in zip(NAMES, faced, strict=True) if not is_faced]
    if not empty:
        return SIX, [PlanEntry(item=item, kept=True, reason="surfaces face all six")]
    stored = facing_directions(faced)
    axes = [name for axis, name in enumerate("xyz") if not stored.has_axis(axis)]
    reads = f", and all reads across {' and '.join(axes)}" if axes else ""
    entry = left_out_entry(
        "directions",
        item=f"slots for travel along {', '.join(empty)}",
        reason="no surface is met from its front by a ray that travels so",
        saved=f"{len(empty)} slots of six{reads}",
    )
    return stored, [entry]


def faced_directions(surfaces: VoxelSurfaces) -> tuple[bool, ...]:
    """Whether rays that travel along +x -x +y -y +z -z can meet any side from its front."""
    normals = unit_normals(surfaces.vertices).astype(np.float32)
    return tuple(
        bool((normals[:, axis] * (1 if side else -1) > 0.0).any())
        for axis in range(3)
        for side in range(2)
    )
