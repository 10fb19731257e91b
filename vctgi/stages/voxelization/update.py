"""Keeping voxels over frames: only what a move made stale is voxelized again.

A moved window rebuilds the slabs that entered it; a changed surface rebuilds the voxels that it
touched before or touches now. What is kept equals a rebuild from scratch bit for bit, because a
voxel's opacity depends on nothing but the surfaces in it and the level's lattice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.regions import (
    Bounds,
    Region,
    newly_covered_regions,
    same_levels,
    stale_regions,
)
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.voxelization.opacity import (
    DEFAULT_CONFIG,
    OpacityVoxelizationConfig,
    fill_regions,
)
from vctgi.stages.voxelization.triangles import DeviceTriangles


def update_opacity(
    opacity: OpacityClipmap,
    triangles: DeviceTriangles,
    layout: ClipmapLayout,
    changed: Sequence[Bounds] = (),
    config: OpacityVoxelizationConfig = DEFAULT_CONFIG,
) -> tuple[OpacityClipmap, list[list[Region]]]:
    """Move the windows of voxelized surfaces and rebuild what became stale.

    Parameters
    ----------
    opacity
        What `voxelize_opacity` or an earlier update returned; used up, its arrays are changed.
    triangles
        All surfaces as they are now.
    layout
        Where the windows stand now; levels of the same sizes.
    changed
        Boxes in world units around what moved, came or went, where it was and where it is.
    config
        As in the first voxelization.

    Returns
    -------
    tuple
        Opacity at each clip level's own resolution, and the boxes of each level that were rebuilt.

    Raises
    ------
    ValueError
        The levels have other sizes than before, or surfaces are made of another thickness.
    """
    if not same_levels(opacity.layout, layout):
        raise ValueError(
            "update_opacity: the levels have other voxel sizes, resolutions or another count than "
            "before; voxelize anew with voxelize_opacity."
        )
    if config.slots != opacity.rule:
        raise ValueError(
            "update_opacity: surfaces were made of another thickness before; "
            "voxelize anew with voxelize_opacity."
        )
    if config.is_complete:
        raise ValueError(
            "update_opacity: is_complete is for comparisons of single frames; leave it out."
        )
    stale = stale_regions(opacity.layout, layout, changed, config.reach_voxels)
    boxes = [box for boxes in stale for box in boxes]
    # A window that covers new voxels uncovers others, so every level that is cleared is filled too.
    cleared = newly_covered_regions(opacity.layout, layout)
    fill_regions(opacity.levels, triangles, boxes, config, cleared)
    return OpacityClipmap(layout, opacity.levels, opacity.rule), stale


def changed_bounds(before: VoxelSurfaces, after: VoxelSurfaces) -> list[Bounds]:
    """Return boxes around the surfaces that two states of a scene do not share.

    Surfaces are compared corner by corner, whatever their order. Those of one object share a box,
    for each state its own; a mask that changed its texture is not seen here.

    Returns
    -------
    list of (low, high)
        World units; empty if nothing changed.
    """
    if before is after:
        return []
    # Most surfaces stay where they are in the list, and only the others are worth sorting.
    places = _unlike_places(before, after)
    rows = [_rows(surfaces, places) for surfaces in (before, after)]
    bounds = []
    for own, other, surfaces in zip(rows, rows[::-1], (before, after), strict=True):
        is_changed = ~np.isin(own, other)
        vertices, shapes = surfaces.vertices[places], surfaces.shape_index[places]
        for shape in np.unique(shapes[is_changed]):
            chosen = vertices[is_changed & (shapes == shape)]
            bounds.append((chosen.min(axis=(0, 1)), chosen.max(axis=(0, 1))))
    return bounds


Places = np.ndarray | slice
"""Which of a list of surfaces."""


def _unlike_places(before: VoxelSurfaces, after: VoxelSurfaces) -> Places:
    """Return where two lists of surfaces differ, byte for byte; all places of unequal lengths."""
    count = len(before.vertices)
    if count != len(after.vertices):
        return slice(None)
    is_unlike = np.zeros(count, dtype=bool)
    for name in ("vertices", "uv", "mask_index"):
        one, other = getattr(before, name), getattr(after, name)
        if one is not other:
            is_unlike |= np.any(_bits(one) != _bits(other), axis=tuple(range(1, one.ndim)))
    return np.flatnonzero(is_unlike)


def _bits(values: np.ndarray) -> np.ndarray:
    """Return numbers as bit patterns, which tell what compares as equal and is not the same."""
    return np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)


def _rows(surfaces: VoxelSurfaces, places: Places) -> np.ndarray:
    """Return one comparable value for each surface: its corners and mask, byte for byte."""
    vertices = surfaces.vertices[places]
    count = len(vertices)
    table = np.concatenate(
        [
            vertices.reshape(count, 9),
            surfaces.uv[places].reshape(count, 6),
            surfaces.mask_index[places, None].astype(np.float64),
        ],
        axis=1,
    )
    rows = np.ascontiguousarray(table).view(np.dtype((np.void, 8 * table.shape[1]))).ravel()
    # Equal surfaces are numbered, so that one of two that goes is missed.
    _, same, copies = np.unique(rows, return_inverse=True, return_counts=True)
    order = np.argsort(same, kind="stable")
    first = np.cumsum(copies) - copies
    number = np.empty(count)
    number[order] = np.arange(count) - np.repeat(first, copies)
    numbered = np.concatenate([table, number[:, None]], axis=1)
    return np.ascontiguousarray(numbered).view(np.dtype((np.void, 8 * numbered.shape[1]))).ravel()
