"""Opacity of every clip level by voxelizing surfaces at that level's own resolution.

The opacity of a voxel along a direction is the covered share of its face across that direction by
surfaces that a ray travelling so meets from their front. One code path fills any box of any level,
so an update of what became stale equals a rebuild. What a finer window covers, and the mips behind
the coarsest level, are left at zero; downsampling fills them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Literal, Union, get_args

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel, voxel_of_place
from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.regions import Region, count_voxels, own_regions, window_region
from vctgi.clipmap.slots import SlotRule
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.voxelization.analytic import UNIT, add_areas
from vctgi.stages.voxelization.candidates import occupied_regions
from vctgi.stages.voxelization.cells import mark_cells
from vctgi.stages.voxelization.columns import (
    BY_CENTRES,
    CELLS_PER_EDGE,
    RegionTable,
    Search,
    enumerate_columns,
    region_table,
)
from vctgi.stages.voxelization.derivative import (
    has_derivatives,
    mirror_areas,
    without_derivatives,
)
from vctgi.stages.voxelization.samples import mark_samples, sample_search
from vctgi.stages.voxelization.triangles import DeviceTriangles, upload_triangles

Coverage = Literal["cells", "samples", "analytic"]

Words = Union["mi.UInt64", "mi.Int64", "mi.Float64"]

WORDS_PER_PASS = 1 << 27
"""64-bit words of coverage that are held at a time (1 GiB); more is done in several passes."""

TEXELS_AT_ONCE = 1 << 16
"""Voxels of boxes above which their addresses are worth a launch of their own."""

MAX_SUPERSAMPLING = 8


@dataclass(frozen=True, kw_only=True)
class OpacityVoxelizationConfig:
    """How surfaces become opacity."""

    coverage: Coverage = "cells"
    """How the covered share of a face is found. "cells": an 8 x 8 grid of cell centres along each
    axis. "samples": the talk's eight samples along the axis of largest projection, reprojected onto
    the others. "analytic": the exact area of each triangle; areas add."""
    max_supersampling: int = 1
    """Largest factor by which the cells of coarse levels are divided: level l has 8 x 2^l cells
    along an edge, up to 8 x this; a power of two in 1 .. 8."""
    is_two_sided: bool = False
    """Whether a surface also stops rays that meet it from behind."""
    slots: SlotRule = field(default_factory=SlotRule)
    """How thick surfaces are made."""
    is_complete: bool = False
    """Whether levels are also voxelized where a finer window covers them, for comparison: rendering
    takes the downsampled voxels there."""

    def __post_init__(self) -> None:
        """Refuse what is not offered."""
        if self.coverage not in get_args(Coverage):
            raise ValueError(
                "OpacityVoxelizationConfig.coverage must be one of "
                f"{', '.join(get_args(Coverage))}, "
                f"got '{self.coverage}'."
            )
        factor = self.max_supersampling
        if not 1 <= factor <= MAX_SUPERSAMPLING or factor & (factor - 1):
            raise ValueError(
                "OpacityVoxelizationConfig.max_supersampling must be a power of two in "
                f"1 .. {MAX_SUPERSAMPLING}, got {factor}."
            )
        if self.coverage == "analytic" and factor > 1:
            raise ValueError(
                "OpacityVoxelizationConfig.max_supersampling must be 1 with analytic coverage, "
                f"which is exact, got {factor}."
            )

    @property
    def reach_voxels(self) -> float:
        """How far from a surface's bounds a voxel that it fills may lie."""
        margin = sample_search(self.slots).margin_voxels if self.coverage == "samples" else 0
        return self.slots.reach_voxels + margin

    def supersampling(self, level: int) -> int:
        """Factor by which the cells of a level are divided."""
        return min(1 << level, self.max_supersampling)


DEFAULT_CONFIG = OpacityVoxelizationConfig()


def voxelize_opacity(
    surfaces: VoxelSurfaces,
    layout: ClipmapLayout,
    config: OpacityVoxelizationConfig = DEFAULT_CONFIG,
) -> OpacityClipmap:
    """Voxelize surfaces at every clip level.

    Parameters
    ----------
    surfaces
        Sides of triangles, front-facing as they are wound.
    layout
        Windows to fill.
    config
        Sampling and thickness.

    Returns
    -------
    OpacityClipmap
        Coverage in steps of 1 / 64, finer where supersampled; zero in the mips.

    References
    ----------
    [Panteleev2014], slides "Voxelization for opacity".
    """
    return voxelize_triangles(upload_triangles(surfaces), layout, config)


def voxelize_triangles(
    triangles: DeviceTriangles,
    layout: ClipmapLayout,
    config: OpacityVoxelizationConfig = DEFAULT_CONFIG,
    thickness: mi.Float | None = None,
) -> OpacityClipmap:
    """Voxelize surfaces that are on the device already, as `voxelize_opacity` does.

    Parameters
    ----------
    triangles
        Surfaces; their corners may have derivatives.
    layout, config
        As there.
    thickness
        `config.slots.thickness_voxels` with derivatives, one lane; None: without.

    Raises
    ------
    ValueError
        Derivatives of another coverage than "analytic", whose cells fill in jumps.
    """
    is_live = has_derivatives(triangles, thickness)
    if is_live and config.coverage != "analytic":
        raise ValueError(
            f'OpacityVoxelizationConfig.coverage "{config.coverage}" has no derivatives, its cells '
            'fill in jumps: set it to "analytic", or detach the vertices and the thickness.'
        )
    levels = [dr.zeros(mi.Float, DIRECTION_COUNT * level.voxel_count) for level in layout.levels]
    regions = [box for level in layout.clip_levels for box in own_regions(layout, level)]
    if config.is_complete:
        regions = [window_region(level) for level in layout.clip_levels]
    growth, live = None, None
    if is_live:
        if dr.grad_enabled(triangles.corners):
            growth = [dr.full(mi.Float, 1.0, dr.width(level)) for level in levels]
        thickness = thickness if dr.grad_enabled(thickness) else None
        live = Live(triangles, thickness, growth)
    triangles = without_derivatives(triangles)
    boxes = occupied_regions(triangles, regions, config.reach_voxels)
    fill_regions(levels, triangles, boxes, config, live=live)
    return OpacityClipmap(
        layout, levels, config.slots, growth, None if live is None else live.thickness
    )


@dataclass
class Live:
    """What coverage has derivatives by, and how it grows.

    Attributes
    ----------
    triangles, thickness
        Triangles, and their thickness if it has derivatives.
    growth
        As in `OpacityClipmap`; changed in place.
    """

    triangles: DeviceTriangles
    thickness: mi.Float | None
    growth: list[mi.Float] | None


def fill_regions(
    levels: list[mi.Float],
    triangles: DeviceTriangles,
    regions: Sequence[Region],
    config: OpacityVoxelizationConfig,
    cleared: Sequence[Region] = (),
    live: Live | None = None,
) -> None:
    """Overwrite the opacity of boxes of voxels.

    Parameters
    ----------
    levels
        Opacities [direction, z, y, x] of each level at toroidal addresses; changed in place.
    triangles
        All surfaces.
    regions
        Boxes to fill; what lies outside is left as it is.
    config
        Sampling and thickness.
    cleared
        Boxes of levels among those of `regions` to set to zero.
    live
        What has derivatives, with analytic coverage; None: nothing.
    """
    for group in _passes(regions, config):
        table = region_table(group, config.supersampling)
        words: list[Words] = [_cover(triangles, table, config)]
        if live is not None:
            words.append(mirror_areas(live.triangles, table, config.slots, live.thickness))
            if live.growth is not None and live.thickness is not None:
                words.append(mirror_areas(live.triangles, table, config.slots, None))
        offset = 0
        for level, boxes in groupby(group, key=lambda region: region.level):
            own = list(boxes)
            voxel_count = count_voxels(own)
            empty = [box for box in cleared if box.level == level]
            growth = None
            if live is not None and live.growth is not None:
                growth = live.growth[level.level]
            _write((levels[level.level], growth), words, own, empty, offset, config)
            offset += DIRECTION_COUNT * config.supersampling(level.level) ** 2 * voxel_count
            # One after the other, so that the kernel is the same whichever levels are stale.
            dr.eval(levels[level.level], growth)


def _cover(
    triangles: DeviceTriangles, table: RegionTable, config: OpacityVoxelizationConfig
) -> mi.UInt64 | mi.Int64:
    """Covered cells, or areas in fixed point, of all faces of a table."""
    if config.coverage == "analytic":
        sums = dr.zeros(mi.Int64, table.word_count)
        for columns in enumerate_columns(triangles, table, config.slots, Search(has_rim=True)):
            add_areas(sums, columns, table, triangles)
            dr.eval(sums)
        return sums
    masks = dr.zeros(mi.UInt64, table.word_count)
    is_sampled = config.coverage == "samples"
    search = sample_search(config.slots) if is_sampled else BY_CENTRES
    for columns in enumerate_columns(triangles, table, config.slots, search):
        if is_sampled:
            mark_samples(masks, columns, table, config.slots, triangles)
        else:
            mark_cells(masks, columns, table, triangles)
        dr.eval(masks)
    return masks


def _passes(regions: Sequence[Region], config: OpacityVoxelizationConfig) -> Iterator[list[Region]]:
    """Split and group boxes, level by level, so that each group fits the memory of a pass."""
    group: list[Region] = []
    held = 0
    for region in sorted(regions, key=lambda region: region.level.level):
        words = DIRECTION_COUNT * config.supersampling(region.level.level) ** 2
        for part in region.split(WORDS_PER_PASS // words):
            if held + words * part.voxel_count > WORDS_PER_PASS:
                yield group
                group, held = [], 0
            group.append(part)
            held += words * part.voxel_count
    if group:
        yield group


def _write(
    result: tuple[mi.Float, mi.Float | None],
    words: list[Words],
    boxes: list[Region],
    empty: list[Region],
    offset: int,
    config: OpacityVoxelizationConfig,
) -> None:
    """Turn the coverage of the boxes of a level into opacity at its texels, and clear others.

    Second words are the same coverage in faces, with derivatives, and third ones those by corners
    alone, if they differ; they come with a second result, `Live.growth`.
    """
    held, *mirrors = words
    opacity, growth = result
    level = boxes[0].level
    factor, voxel_count = config.supersampling(level.level), count_voxels(boxes + empty)
    # What differs from frame to frame is opaque, so that a moved camera compiles nothing.
    written, base = dr.opaque(mi.UInt32, voxel_count), dr.opaque(mi.UInt32, offset)
    count = dr.opaque(mi.UInt32, count_voxels(boxes))
    lane = dr.arange(mi.UInt32, DIRECTION_COUNT * voxel_count)
    slot, place = lane // written, lane % written
    is_covered = place < count
    if voxel_count < TEXELS_AT_ONCE:
        texel = texel_from_voxel(voxel_of_place(place, boxes + empty), level.resolution)
    else:
        every = voxel_of_place(dr.arange(mi.UInt32, voxel_count), boxes + empty)
        texel = dr.gather(mi.UInt32, texel_from_voxel(every, level.resolution), place)

    def word(slot: mi.UInt32, sub_face: int) -> mi.UInt32:
        return base + (slot * factor**2 + sub_face) * count + place

    if isinstance(held, mi.Int64):
        sides = [slot, slot ^ 1] if config.is_two_sided else [slot]
        areas = mi.Int64(0)
        for side in sides:
            areas += dr.gather(mi.Int64, held, word(side, 0), is_covered)
        plain = mi.Float64(areas) / UNIT

        def live(sums: Words) -> mi.Float64:
            found = mi.Float64(plain)
            for side in sides:
                # Values of the integers, derivatives of the mirror: what is added is zero.
                own = dr.gather(mi.Float64, sums, word(side, 0), is_covered)
                found += own - dr.detach(own)
            return found

        share = dr.minimum(mi.Float(live(mirrors[0]) if mirrors else plain), 1.0)
        if growth is not None:
            value = dr.select(areas > 0, plain, 1.0)
            grown = mi.Float(dr.select(areas > 0, live(mirrors[-1]) / value, 1.0))
            dr.scatter(growth, grown, texel + slot * level.voxel_count)
    else:
        covered = mi.UInt32(0)
        for sub_face in range(factor**2):
            bits = dr.gather(mi.UInt64, held, word(slot, sub_face), is_covered)
            if config.is_two_sided:
                bits |= dr.gather(mi.UInt64, held, word(slot ^ 1, sub_face), is_covered)
            covered += mi.UInt32(dr.popcnt(bits))
        share = mi.Float(covered) * (1.0 / (factor * CELLS_PER_EDGE) ** 2)
    dr.scatter(opacity, share, texel + slot * level.voxel_count)
