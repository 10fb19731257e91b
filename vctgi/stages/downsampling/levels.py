"""Direction-aware downsampling: 2^3 voxels of a level into one of the next.

Across a direction the four columns of children average. Along it the two children of a column add,
up to 1, the one behind filling only what the one in front leaves open. Adding is exact for the
parts of one slanted plane, which are complementary; composing them as if they were independent
would lose light at every level (docs/decisions/0001). Two simpler rules, averages over all eight
children and one value for all directions, are there for comparison.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import is_inside, texel_from_voxel, voxel_of_place
from vctgi.clipmap.isotropic import same_for_all_directions
from vctgi.clipmap.regions import Region, window_region
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.downsampling.config import DEFAULT_DOWNSAMPLING, DownsamplingConfig, MipRule
from vctgi.stages.downsampling.merging import children, merge_emittance, merge_opacity


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
        base = slot * finer.voxel_count
        columns = [
            (
                base + texel_from_voxel(front, finer.resolution),
                base + texel_from_voxel(back, finer.resolution),
            )
            for front, back in children(parent, slot, mips)
        ]
        fine = merged.levels[finer.level]
        alpha, shares = merge_opacity(
            [
                (dr.gather(mi.Float, fine, front), dr.gather(mi.Float, fine, back))
                for front, back in columns
            ],
            mips,
        )
        own = dr.gather(mi.Float, opacity.levels[coarser.level], target, ~is_covered)
        dr.scatter(merged.levels[coarser.level], dr.select(is_covered, alpha, own), target)
        if emittance is not None and lit is not None:
            colors = lit.levels[finer.level]
            color = merge_emittance(
                [
                    (dr.gather(mi.Color3f, colors, front), dr.gather(mi.Color3f, colors, back))
                    for front, back in columns
                ],
                shares,
            )
            own_color = dr.gather(mi.Color3f, emittance.levels[coarser.level], target, ~is_covered)
            dr.scatter(lit.levels[coarser.level], dr.select(is_covered, color, own_color), target)
            # Opacity and emittance in one launch.
            dr.eval(lit.levels[coarser.level])
        dr.eval(merged.levels[coarser.level])


def _slots_of(regions: Sequence[Region]) -> tuple[mi.Vector3i, mi.UInt32]:
    """Every voxel of boxes with each of its six directions, one lane each."""
    count = sum(region.voxel_count for region in regions)
    lane = dr.arange(mi.UInt32, DIRECTION_COUNT * count)
    width = dr.opaque(mi.UInt32, count)
    return voxel_of_place(lane % width, regions), lane // width
