"""Two opacities of the same voxels, compared: by picture and by number.

Serves every question of the kind "the fast one against the exact one": sampled coverage against
analytic coverage, a level voxelized by itself against one made by downsampling.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.addressing import is_inside, voxel_from_texel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.debug.camera import PixelRays
from vctgi.debug.ray_cast import VISIBLE_OPACITY, facing_opacities, first_voxels
from vctgi.debug.voxels import level_voxels
from vctgi.maths.directions import DIRECTION_COUNT


@dataclass(frozen=True, kw_only=True)
class DifferenceNumbers:
    """First minus second over all slots that are not empty in both.

    Attributes
    ----------
    slot_count
        Those slots.
    mean, rms, largest
        Mean, root of the mean square, largest absolute difference; 0 when there are no slots.
    total_ratio
        Sum of the first over the sum of the second; None where the second has nothing.
    """

    slot_count: int
    mean: float
    rms: float
    largest: float
    total_ratio: float | None


@dataclass
class OpacityDifference:
    """How far two opacities of one level lie apart.

    Attributes
    ----------
    level
        Which level.
    is_hit
        [y, x] whether either of the two shows a voxel there.
    difference
        [y, x] first minus second, of the facing slot where it is largest, [-1, 1]; 0 without a hit.
    numbers
        The same in numbers, over all voxels.
    """

    level: int
    is_hit: np.ndarray
    difference: np.ndarray
    numbers: DifferenceNumbers


def compare_opacity(
    first: OpacityClipmap,
    second: OpacityClipmap,
    level: int,
    rays: PixelRays,
    within: LevelLayout | None = None,
) -> OpacityDifference:
    """Compare one level of two clipmaps of the same layout.

    Parameters
    ----------
    first, second
        The tested one and the one that it is measured by.
    level
        Which level.
    rays
        Camera of the picture.
    within
        Compare only voxels whose eight children lie in the window of this next finer level; None
        for all.
    """
    assert first.layout == second.layout, "opacities of two layouts cannot be compared"
    layout = first.layout.levels[level]
    if within is not None:
        assert within.level == level - 1, "children lie in the next finer level"
        first, second = (_cut(c, layout, within) for c in (first, second))
    a, b = first.levels[level], second.levels[level]
    either = OpacityClipmap(
        first.layout,
        [dr.maximum(a, b) if n == level else v for n, v in enumerate(first.levels)],
    )
    hits = first_voxels(level_voxels(either, level), rays, VISIBLE_OPACITY)
    seen_first, seen_second = (
        facing_opacities(level_voxels(c, level), hits.texel, hits.direction, hits.is_hit)
        for c in (first, second)
    )
    shown = mi.Float(0.0)
    for one, other in zip(seen_first, seen_second, strict=True):
        apart = one - other
        shown = dr.select(dr.abs(apart) > dr.abs(shown), apart, shown)
    return OpacityDifference(
        level=level,
        is_hit=rays.picture(hits.is_hit),
        difference=rays.picture(dr.select(hits.is_hit, shown, 0.0)),
        numbers=difference_numbers(np.array(a, dtype=np.float64), np.array(b, dtype=np.float64)),
    )


def difference_numbers(first: np.ndarray, second: np.ndarray) -> DifferenceNumbers:
    """Return how far two arrays of opacities lie apart."""
    is_filled = (first > 0.0) | (second > 0.0)
    apart = (first - second)[is_filled]
    total = float(second.sum())
    ratio = float(first.sum()) / total if total > 0.0 else None
    if len(apart) == 0:
        return DifferenceNumbers(slot_count=0, mean=0.0, rms=0.0, largest=0.0, total_ratio=ratio)
    return DifferenceNumbers(
        slot_count=len(apart),
        mean=float(apart.mean()),
        rms=float(np.sqrt(np.mean(apart**2))),
        largest=float(np.abs(apart).max()),
        total_ratio=ratio,
    )


def _cut(opacity: OpacityClipmap, level: LevelLayout, finer: LevelLayout) -> OpacityClipmap:
    """Return a clipmap whose level is empty outside the finer window."""
    voxel = voxel_from_texel(dr.arange(mi.UInt32, level.voxel_count), level)
    is_covered = dr.tile(is_inside(2 * voxel, finer), DIRECTION_COUNT)
    levels = list(opacity.levels)
    levels[level.level] = dr.select(is_covered, levels[level.level], 0.0)
    dr.eval(levels[level.level])
    return OpacityClipmap(opacity.layout, levels)
