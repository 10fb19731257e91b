"""Emittance voxelization: surfaces that shine by themselves become emittance of voxels.

The three steps of the talk: the brightness of a surface, weighed by the share of the voxel's face
that it covers; the sum of that with its normal over all surfaces in the voxel; and the emittance
along each direction. Here the normal of each surface decides which slots its share goes to before
it is summed: for one surface that is the same, and two that face apart keep their light where a
mean of their normals has lost it. Coverage is analytic, so a lamp far smaller than a voxel keeps
its power wherever it stands.
"""

from __future__ import annotations

import math
from typing import cast

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.addressing import texel_from_voxel, voxel_of_place
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.regions import Region, count_voxels, merged, world_region
from vctgi.clipmap.slots import SlotRule
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.emissive import EmissiveSurfaces
from vctgi.stages.voxelization.analytic import UNIT, add_areas, add_weighed_areas
from vctgi.stages.voxelization.clipped_area import clipped_area
from vctgi.stages.voxelization.columns import (
    CELLS_PER_EDGE,
    Columns,
    Search,
    enumerate_columns,
    region_table,
)
from vctgi.stages.voxelization.triangles import DeviceTriangles, upload_triangles


def voxelize_emission(
    emissive: EmissiveSurfaces, opacity: OpacityClipmap
) -> tuple[OpacityClipmap, EmittanceClipmap]:
    """Write the light of emitters into voxels.

    Parameters
    ----------
    emissive
        What shines.
    opacity
        Opacity at each clip level's own resolution.

    Returns
    -------
    tuple
        Opacity, raised to the share that emitters cover where it was less (a lamp too small for
        the cells of opacity has none, and what has no opacity is never seen); and the emittance:
        radiance times covered share, W m^-2 sr^-1. Zero in the mips.

    References
    ----------
    [Panteleev2014], slides "Voxelization for emittance".
    """
    layout = opacity.layout
    alphas = [mi.Float(level) for level in opacity.levels]
    colors = [dr.zeros(mi.Color3f, DIRECTION_COUNT * each.voxel_count) for each in layout.levels]
    triangles = upload_triangles(emissive.surfaces)
    for level in layout.clip_levels if triangles.count else ():
        boxes = _boxes(emissive, level, opacity.rule)
        if boxes:
            number = mi.UInt32(emissive.emitter_number)
            _fill(alphas, colors, triangles, number, boxes, opacity.rule)
    lit = EmittanceClipmap(layout, colors, [0.0] * layout.clip_level_count)
    return OpacityClipmap(layout, alphas, opacity.rule), lit


def _boxes(emissive: EmissiveSurfaces, level: LevelLayout, rule: SlotRule) -> list[Region]:
    """Boxes of voxels that the emitters of each shape may touch."""
    boxes = []
    for shape in np.unique(emissive.surfaces.shape_index):
        corners = emissive.surfaces.vertices[emissive.surfaces.shape_index == shape]
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        box = world_region(level, low, high, rule.reach_voxels)
        if box is not None:
            boxes.append(box)
    return merged(boxes)


def _fill(
    alphas: list[mi.Float],
    colors: list[mi.Color3f],
    triangles: DeviceTriangles,
    emitter_number: mi.UInt32,
    boxes: list[Region],
    rule: SlotRule,
) -> None:
    """Overwrite emittance, and raise opacity, in boxes of a level."""
    level = boxes[0].level
    table = region_table(boxes, lambda _: 1)
    passes = list(enumerate_columns(triangles, table, rule, Search(has_rim=True)))
    radiances = [_mean_radiance(columns, triangles, emitter_number) for columns in passes]
    dr.eval(radiances)
    brightest = max((float(dr.max(dr.max(each))[0]) for each in radiances), default=0.0)
    if not math.isfinite(brightest):
        raise ValueError("voxelize_emission: an emitter's radiance is not finite; correct it.")
    # A power of two, so that the sums do not depend on their order nor on the unit of light.
    step = 2.0 ** math.ceil(math.log2(brightest)) if brightest > 0.0 else 1.0
    areas = dr.zeros(mi.Int64, table.word_count)
    light = [dr.zeros(mi.Int64, table.word_count) for _ in range(3)]
    for columns, radiance in zip(passes, radiances, strict=True):
        add_areas(areas, columns, table, triangles)
        weights = [mi.Float64((radiance / step)[channel]) for channel in range(3)]
        add_weighed_areas(light, weights, columns, table)
        dr.eval(areas, light)

    count = count_voxels(boxes)
    lane = dr.arange(mi.UInt32, DIRECTION_COUNT * count)
    texel = texel_from_voxel(voxel_of_place(lane % count, boxes), level.resolution)
    index = texel + lane // count * level.voxel_count
    covered = mi.Float64(areas) / UNIT
    # Emitters that cover a face more than once hide one another.
    shown = step / UNIT / dr.maximum(covered, 1.0)
    color = mi.Color3f([mi.Float(mi.Float64(sums) * shown) for sums in light])
    held = dr.gather(mi.Float, alphas[level.level], index)
    share = mi.Float(dr.minimum(covered, 1.0))
    dr.scatter(alphas[level.level], dr.maximum(held, share), index)
    dr.scatter(colors[level.level], color, index)
    dr.eval(alphas[level.level], colors[level.level])


def _mean_radiance(
    columns: Columns, triangles: DeviceTriangles, emitter_number: mi.UInt32
) -> mi.Color3f:
    """Mean radiance of what a triangle covers of a face, cell by cell, W m^-2 sr^-1."""
    view = columns.view
    low_u, low_v = (mi.Float64(face * CELLS_PER_EDGE) for face in (columns.face_u, columns.face_v))
    number = dr.gather(mi.UInt32, emitter_number, view.triangle)
    emitter = cast("mi.EmitterPtr", dr.reinterpret_array(mi.EmitterPtr, number))
    lanes = dr.width(columns.face_u)

    def body(
        cell: mi.UInt32, total: mi.Float64, light: list[mi.Float64]
    ) -> tuple[mi.UInt32, mi.Float64, list[mi.Float64]]:
        u = low_u + mi.Float64(cell % CELLS_PER_EDGE)
        v = low_v + mi.Float64(cell // CELLS_PER_EDGE)
        area = clipped_area(
            view.u,
            view.v,
            view.depth,
            (u, v, view.low_depth - 1.0),
            (u + 1.0, v + 1.0, view.high_depth + 1.0),
        )
        seen = _radiance_at(emitter, columns, triangles, u + 0.5, v + 0.5)
        added = [dr.fma(area, mi.Float64(seen[channel]), light[channel]) for channel in range(3)]
        return cell + 1, total + area, added

    _, total, light = dr.while_loop(
        state=(
            dr.zeros(mi.UInt32, lanes),
            dr.zeros(mi.Float64, lanes),
            [dr.zeros(mi.Float64, lanes) for _ in range(3)],
        ),
        cond=lambda cell, total, light: cell < CELLS_PER_EDGE**2,
        body=body,
        label="mean_radiance",
    )
    scale = 1.0 / dr.select(total > 0.0, total, 1.0)
    return mi.Color3f([mi.Float(mi.Float64(channel) * scale) for channel in light])


def _radiance_at(
    emitter: mi.EmitterPtr,
    columns: Columns,
    triangles: DeviceTriangles,
    cell_u: mi.Float64,
    cell_v: mi.Float64,
) -> mi.Color3f:
    """Radiance of triangles at a place of their projection, or at the nearest to it on them."""
    view = columns.view
    (u0, u1, u2), (v0, v1, v2) = view.u, view.v
    doubled = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
    per_doubled = 1.0 / dr.select(doubled == 0.0, 1.0, doubled)
    to_u, to_v = cell_u - u0, cell_v - v0
    second = (to_u * (v2 - v0) - (u2 - u0) * to_v) * per_doubled
    third = ((u1 - u0) * to_v - to_u * (v1 - v0)) * per_doubled
    shares = [dr.maximum(each, 0.0) for each in (1.0 - second - third, second, third)]
    total = shares[0] + shares[1] + shares[2]
    uv = mi.Point2f(0.0)
    for share, corner in zip(shares, triangles.uv, strict=True):
        uv += as_component(mi.Float(share / total)) * dr.gather(mi.Point2f, corner, view.triangle)
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(uv))
    si.uv = uv
    si.wi = mi.Vector3f(0.0, 0.0, 1.0)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    return mi.Color3f(emitter.eval(si))
