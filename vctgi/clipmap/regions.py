"""Boxes of voxels, and which of them a moved window or a changed object makes stale."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vctgi.clipmap.levels import ClipmapLayout, LevelLayout

Corner = tuple[int, int, int]
Bounds = tuple[np.ndarray, np.ndarray]
"""Lowest and highest corner of a box, [3] each, world units."""


@dataclass(frozen=True, kw_only=True)
class Region:
    """A box of voxels of one level.

    Attributes
    ----------
    level
        Window that the box lies in.
    low, high
        Lowest voxel, and the one past the highest, (x, y, z) in the level's lattice.
    """

    level: LevelLayout
    low: Corner
    high: Corner

    @property
    def shape(self) -> Corner:
        """Voxels along x, y, z."""
        x, y, z = (top - bottom for bottom, top in zip(self.low, self.high, strict=True))
        return x, y, z

    @property
    def voxel_count(self) -> int:
        """Voxels of the box."""
        return math.prod(self.shape)

    def split(self, max_voxel_count: int) -> Iterator[Region]:
        """Yield parts of at most `max_voxel_count` voxels, halved along their longest edges."""
        if self.voxel_count <= max_voxel_count or self.voxel_count == 1:
            yield self
            return
        axis = int(np.argmax(self.shape))
        middle = (self.low[axis] + self.high[axis]) // 2
        yield from replace(self, high=_with(self.high, axis, middle)).split(max_voxel_count)
        yield from replace(self, low=_with(self.low, axis, middle)).split(max_voxel_count)


def _with(corner: Corner, axis: int, value: int) -> Corner:
    changed = list(corner)
    changed[axis] = value
    x, y, z = changed
    return x, y, z


def window_region(level: LevelLayout) -> Region:
    """Return all voxels of a level."""
    x, y, z = (o + level.resolution for o in level.origin)
    return Region(level=level, low=level.origin, high=(x, y, z))


def intersection(first: Region, second: Region) -> Region | None:
    """Return the voxels in both boxes of one lattice, or None; the level is that of `first`."""
    low = tuple(max(a, b) for a, b in zip(first.low, second.low, strict=True))
    high = tuple(min(a, b) for a, b in zip(first.high, second.high, strict=True))
    if any(bottom >= top for bottom, top in zip(low, high, strict=True)):
        return None
    return Region(level=first.level, low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


def difference(whole: Region, hole: Region) -> list[Region]:
    """Return up to six disjoint boxes with the voxels of `whole` that are not in `hole`."""
    kept = intersection(whole, hole)
    if kept is None:
        return [whole]
    parts, rest = [], whole
    for axis in range(3):
        if rest.low[axis] < kept.low[axis]:
            parts.append(replace(rest, high=_with(rest.high, axis, kept.low[axis])))
            rest = replace(rest, low=_with(rest.low, axis, kept.low[axis]))
        if rest.high[axis] > kept.high[axis]:
            parts.append(replace(rest, low=_with(rest.low, axis, kept.high[axis])))
            rest = replace(rest, high=_with(rest.high, axis, kept.high[axis]))
    return parts


def entered_regions(before: LevelLayout, after: LevelLayout) -> list[Region]:
    """Return the voxels that a moved window holds now and did not hold before.

    Levels of another voxel size or resolution have nothing in common: then all of them.
    """
    whole = window_region(after)
    if (before.voxel_size, before.resolution) != (after.voxel_size, after.resolution):
        return [whole]
    return difference(whole, window_region(before))


def world_region(
    level: LevelLayout, low: np.ndarray, high: np.ndarray, reach_voxels: float
) -> Region | None:
    """Return the voxels of a window that a box in world units touches or comes near."""
    first = np.floor(np.asarray(low) / level.voxel_size - reach_voxels).astype(np.int64)
    last = np.floor(np.asarray(high) / level.voxel_size + reach_voxels).astype(np.int64) + 1
    box = Region(
        level=level,
        low=(int(first[0]), int(first[1]), int(first[2])),
        high=(int(last[0]), int(last[1]), int(last[2])),
    )
    return intersection(window_region(level), box)


def merged(boxes: Sequence[Region]) -> list[Region]:
    """Return boxes that hold all of `boxes`, with those made one that fill or overlap a box."""
    found: list[Region] = []
    for new in boxes:
        box = new
        for other in list(found):
            both = _around(box, other)
            if both.voxel_count <= box.voxel_count + other.voxel_count:
                found.remove(other)
                box = both
        found.append(box)
    return found


def _around(first: Region, second: Region) -> Region:
    """Return the smallest box that holds two."""
    low = tuple(min(a, b) for a, b in zip(first.low, second.low, strict=True))
    high = tuple(max(a, b) for a, b in zip(first.high, second.high, strict=True))
    return Region(level=first.level, low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


def covered_region(finer: LevelLayout, coarser: LevelLayout) -> Region | None:
    """Return the voxels of a level whose eight children all lie in the next finer window."""
    low = [-(-o // 2) for o in finer.origin]
    high = [(o + finer.resolution) // 2 for o in finer.origin]
    box = Region(level=coarser, low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))
    return intersection(window_region(coarser), box)


def own_regions(layout: ClipmapLayout, level: LevelLayout) -> list[Region]:
    """Return the voxels of a level that it does not get from a finer window."""
    covered = covered_by_finer(layout, level)
    whole = window_region(level)
    return [whole] if covered is None else difference(whole, covered)


def covered_by_finer(layout: ClipmapLayout, level: LevelLayout) -> Region | None:
    """Return the voxels of a level that it gets from a finer window, if there is one."""
    return None if level.level == 0 else covered_region(layout.levels[level.level - 1], level)


def parent_region(child: Region, coarser: LevelLayout) -> Region | None:
    """Return the voxels of the next coarser level that contain voxels of a box."""
    low = [i // 2 for i in child.low]
    high = [-(-i // 2) for i in child.high]
    box = Region(level=coarser, low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))
    return intersection(window_region(coarser), box)


def stale_regions(
    before: ClipmapLayout, after: ClipmapLayout, changed: Sequence[Bounds], reach_voxels: float
) -> list[list[Region]]:
    """Return what has to be voxelized anew, for each level; nothing for the mips.

    That is what entered a window, what a finer window no longer covers, and what changed; but
    nothing that a finer window covers now.

    Parameters
    ----------
    before, after
        Windows of levels of the same sizes.
    changed
        Boxes (lowest, highest corner) in world units in which surfaces moved, came or went.
    reach_voxels
        How far from a surface's bounds a voxel that it fills may lie.
    """
    stale: list[list[Region]] = []
    for old, new in zip(before.clip_levels, after.clip_levels, strict=True):
        touched = [world_region(new, low, high, reach_voxels) for low, high in changed]
        boxes = entered_regions(old, new) + merged([b for b in touched if b is not None])
        covered = covered_by_finer(after, new)
        was_covered = covered_by_finer(before, old)
        uncovered = None if was_covered is None else intersection(window_region(new), was_covered)
        if uncovered is not None:
            boxes.append(uncovered)
        if covered is not None:
            boxes = [part for box in boxes for part in difference(box, covered)]
        stale.append(boxes)
    return stale + [[] for _ in after.levels[after.clip_level_count :]]


def newly_covered_regions(before: ClipmapLayout, after: ClipmapLayout) -> list[Region]:
    """Return what finer windows cover now and did not cover before."""
    found = []
    for level in after.clip_levels:
        covered = covered_by_finer(after, level)
        if covered is not None:
            old = covered_by_finer(before, before.levels[level.level])
            found += [covered] if old is None else difference(covered, old)
    return found


def unmerged_regions(
    before: ClipmapLayout, after: ClipmapLayout, stale: Sequence[Sequence[Region]]
) -> list[list[Region]]:
    """Return what has to be downsampled anew, for each level, when `stale` was filled anew.

    A voxel changes if it is stale itself, if one of its children changes, or if the finer window
    has moved to it or away from it.
    """
    unmerged = [list(stale[0])]
    for finer, coarser in zip(after.levels[:-1], after.levels[1:], strict=True):
        parents = [parent_region(child, coarser) for child in unmerged[-1]]
        boxes = list(stale[coarser.level]) + [box for box in parents if box is not None]
        old = covered_region(before.levels[finer.level], coarser)
        new = covered_region(finer, coarser)
        if old is not None and new is not None:
            boxes += difference(old, new) + difference(new, old)
        else:
            boxes += [box for box in (old, new) if box is not None]
        unmerged.append(boxes)
    return unmerged


def count_voxels(regions: Iterable[Region]) -> int:
    """Voxels of all boxes, those that several share counted several times."""
    return sum(region.voxel_count for region in regions)


def same_levels(first: ClipmapLayout, second: ClipmapLayout) -> bool:
    """Whether two layouts have levels of the same sizes, wherever their windows stand."""
    return [(x.voxel_size, x.resolution) for x in first.levels] == [
        (x.voxel_size, x.resolution) for x in second.levels
    ] and (first.clip_level_count, first.spare_level_count) == (
        second.clip_level_count,
        second.spare_level_count,
    )
