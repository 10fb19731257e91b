"""Direction-aware downsampling: 2^3 voxels of a level into one of the next.

Across a direction the four columns of children average. Along it the two children of a column add,
up to 1, the one behind filling only what the one in front leaves open. Adding is exact for the
parts of one slanted plane, which are complementary; composing them as if they were independent
would lose light at every level (docs/decisions/0001). Two simpler rules, averages over all eight
children and one value for all directions, are there for comparison.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import is_inside, texel_from_voxel, voxel_of_place
from vctgi.clipmap.isotropic import same_for_all_directions
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.regions import Region, window_region
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.stub_gaps import as_component

MipRule = Literal["columns", "average"]
"""How eight children make a voxel. "columns": along each direction the two of a column add up;
"average": their mean, in which a wall of one voxel opens more at every level."""


@dataclass(frozen=True, kw_only=True)
class DownsamplingConfig:
    """How levels are filled from finer ones."""

    mips: MipRule = "columns"
    """How eight children make a voxel."""
    is_isotropic: bool = False
    """Whether a voxel is first made the same from all sides: as opaque as its most opaque slot,
    and as bright as all of them on average."""

    def __post_init__(self) -> None:
        """Refuse rules that do not exist."""
        if self.mips not in get_args(MipRule):
            raise ValueError(
                f"DownsamplingConfig.mips must be one of {get_args(MipRule)}, got {self.mips!r}."
            )


DEFAULT_DOWNSAMPLING = DownsamplingConfig()


def downsample(
    opacity: OpacityClipmap,
    emittance: EmittanceClipmap | None,
    config: DownsamplingConfig = DEFAULT_DOWNSAMPLING,
) -> tuple[OpacityClipmap, EmittanceClipmap | None]:
    """Fill every level from the finer one, where that covers it.

    Parameters
    ----------
    opacity, emittance
        Values voxelized and injected at each clip level's own resolution; emittance may be left
        out when only opacity is wanted.
    config
        Rule of the mips.

    Returns
    -------
    tuple
        The same with the centre of every coarser clip level, and all mips, made from finer voxels.

    References
    ----------
    [Panteleev2014], slide "Multi-resolution voxelization".
    """
    layout = opacity.layout
    if config.is_isotropic:
        opacity, emittance = same_for_all_directions(opacity, emittance)
    alphas = [opacity.levels[0]] + [dr.empty(mi.Float, dr.width(a)) for a in opacity.levels[1:]]
    merged = OpacityClipmap(layout, alphas, opacity.rule)
    lit = None
    if emittance is not None:
        colors = [emittance.levels[0]]
        colors += [dr.empty(mi.Color3f, dr.width(c)) for c in emittance.levels[1:]]
        lit = EmittanceClipmap(layout, colors, list(emittance.lost_flux_share))
    regions = [[window_region(level)] for level in layout.levels]
    downsample_regions(opacity, emittance, merged, lit, regions, config.mips)
    return merged, lit


def downsample_regions(
    opacity: OpacityClipmap,
    emittance: EmittanceClipmap | None,
    merged: OpacityClipmap,
    lit: EmittanceClipmap | None,
    regions: Sequence[Sequence[Region]],
    mips: MipRule = "columns",
) -> None:
    """Fill boxes of every level from the finer one, where that covers them.

    Parameters
    ----------
    opacity, emittance
        As for `downsample`. Their finest level is that of the result itself.
    merged, lit
        The result, changed in place; `lit` goes with `emittance`.
    regions
        Boxes for each level, which may overlap; what lies outside is left as it is.
    mips
        How eight children make a voxel.
    """
    layout = opacity.layout
    merged.levels[0] = opacity.levels[0]
    if emittance is not None and lit is not None:
        lit.levels[0] = emittance.levels[0]
    for finer, coarser in zip(layout.levels[:-1], layout.levels[1:], strict=True):
        if not regions[coarser.level]:
            continue
        parent, slot = _slots_of(regions[coarser.level])
        target = slot * coarser.voxel_count + texel_from_voxel(parent, coarser.resolution)
        # Windows are snapped so that the first child decides for all eight.
        is_covered = is_inside(2 * parent, finer)
        columns = _columns(parent, slot if mips == "columns" else mi.UInt32(0), finer)
        if mips == "average":
            columns = _in_slot(columns, slot, finer)
        alpha, shares = _merge_opacity(columns, merged.levels[finer.level], mips)
        own = dr.gather(mi.Float, opacity.levels[coarser.level], target, ~is_covered)
        dr.scatter(merged.levels[coarser.level], dr.select(is_covered, alpha, own), target)
        if emittance is not None and lit is not None:
            color = _merge_emittance(columns, shares, lit.levels[finer.level])
            own_color = dr.gather(mi.Color3f, emittance.levels[coarser.level], target, ~is_covered)
            dr.scatter(lit.levels[coarser.level], dr.select(is_covered, color, own_color), target)
            # Opacity and emittance in one launch.
            dr.eval(lit.levels[coarser.level])
        dr.eval(merged.levels[coarser.level])


@dataclass
class _Columns:
    """Texels in front and behind, for each of the four columns of children along a direction."""

    texels: list[tuple[mi.UInt32, mi.UInt32]]


def _slots_of(regions: Sequence[Region]) -> tuple[mi.Vector3i, mi.UInt32]:
    """Every voxel of boxes with each of its six directions, one lane each."""
    count = sum(region.voxel_count for region in regions)
    lane = dr.arange(mi.UInt32, DIRECTION_COUNT * count)
    width = dr.opaque(mi.UInt32, count)
    return voxel_of_place(lane % width, regions), lane // width


def _columns(parent: mi.Vector3i, slot: mi.UInt32, finer: LevelLayout) -> _Columns:
    """Return where the children of a voxel are stored, column by column along the direction."""
    axis, side = slot // 2, mi.Int32(slot % 2)
    base = slot * finer.voxel_count
    texels = []
    for step_u in range(2):
        for step_v in range(2):
            pair = []
            # A ray towards +axis meets the lower child first.
            for step in (side, 1 - side):
                child = [
                    2 * mi.Int32(parent[world_axis])
                    + dr.select(axis == world_axis, step, 0)
                    + dr.select((axis + 1) % 3 == world_axis, mi.Int32(step_u), 0)
                    + dr.select((axis + 2) % 3 == world_axis, mi.Int32(step_v), 0)
                    for world_axis in range(3)
                ]
                pair.append(base + texel_from_voxel(mi.Vector3i(child), finer.resolution))
            texels.append((pair[0], pair[1]))
    return _Columns(texels)


def _in_slot(columns: _Columns, slot: mi.UInt32, finer: LevelLayout) -> _Columns:
    """Return the places in a slot of children that were found for the first one.

    A mean over children in one order for all slots keeps slots alike that are.
    """
    start = slot * finer.voxel_count
    return _Columns([(front + start, back + start) for front, back in columns.texels])


def _merge_opacity(
    columns: _Columns, fine: mi.Float, mips: MipRule
) -> tuple[mi.Float, list[mi.Float]]:
    """Mean opacity over the columns, and which share of each back child shows in it."""
    if mips == "average":
        texels = [texel for pair in columns.texels for texel in pair]
        total = sum((dr.gather(mi.Float, fine, texel) for texel in texels), mi.Float(0.0))
        return total / len(texels), []
    mean, shares = mi.Float(0.0), []
    for pair in columns.texels:
        front, back = (dr.gather(mi.Float, fine, texel) for texel in pair)
        visible = dr.minimum(1.0 - front, back)
        mean += 0.25 * (front + visible)
        shares.append(dr.select(back > 0.0, visible / dr.select(back > 0.0, back, 1.0), 0.0))
    return mean, shares


def _merge_emittance(columns: _Columns, shares: list[mi.Float], fine: mi.Color3f) -> mi.Color3f:
    """Mean emittance over the columns, each merged front to back, or over all of no shares."""
    mean = mi.Color3f(0.0)
    if not shares:
        for texel in (texel for pair in columns.texels for texel in pair):
            mean += dr.gather(mi.Color3f, fine, texel) / (2.0 * len(columns.texels))
        return mean
    for pair, share in zip(columns.texels, shares, strict=True):
        front, back = (dr.gather(mi.Color3f, fine, texel) for texel in pair)
        mean += 0.25 * dr.fma(as_component(share), back, front)
    return mean
