"""Gather: each covered slot collects the splats that touch it, from buckets of one slot each.

The sums are the same integers as those of the scatter; only who adds them differs. Nothing is
written by two lanes at once, but a slot that many texels light keeps one lane busy.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel, voxel_from_texel
from vctgi.clipmap.levels import LevelLayout
from vctgi.stages.light_injection.splats import (
    CoveredSlots,
    Splats,
    fixed_point,
    kernel_weight,
    neighbour,
)
from vctgi.stages.light_injection.target import NOWHERE, Target


@dataclass
class _Buckets:
    """Splats sorted by the slot that they lie in.

    Attributes
    ----------
    order
        Numbers of splats, bucket after bucket.
    starts
        Where the bucket of each slot [side, voxel] of the axis begins, and the end of the last.
    """

    order: mi.UInt32
    starts: mi.UInt32


def gather_splats(
    target: Target, splats: Splats, covered: CoveredSlots, axis: int, width: int
) -> None:
    """Add splats of an axis to the sums of a target, as `scatter_splats` does."""
    level = covered.level
    buckets = _sort(splats, level, axis)
    slot = _lit_slots(target, covered, axis)
    lanes = dr.width(slot)
    if lanes == 0:
        return
    texel, side = slot % level.voxel_count, slot // level.voxel_count
    index = slot + 2 * axis * level.voxel_count
    held = dr.gather(mi.Float, covered.drawing, index)
    voxel = voxel_from_texel(texel, level)
    box_count = width**3

    def body(
        number: mi.UInt32, entry: mi.UInt32, end: mi.UInt32, sums: list[mi.Int64]
    ) -> tuple[mi.UInt32, mi.UInt32, mi.UInt32, list[mi.Int64]]:
        # Numbers count from 1; before the first bucket and after each there is one to be opened.
        has_splat = entry < end
        splat = dr.gather(mi.UInt32, buckets.order, entry, has_splat)
        light = [dr.gather(mi.Float, channel, splat, has_splat) for channel in splats.light]
        weight = None
        if width > 1:
            step = neighbour(dr.maximum(number, 1) - 1, width)
            per_weight = dr.gather(mi.Float, splats.per_weight, splat, has_splat)
            weight = kernel_weight(step, covered.taps) * held * per_weight
        amounts = fixed_point(light, weight, target.device_steps)
        added = [
            total + dr.select(has_splat, amount, 0)
            for total, amount in zip(sums, amounts, strict=True)
        ]
        opened = dr.select(has_splat, number, number + 1)
        is_opening = ~has_splat & (opened <= box_count)
        # The splats that reach this voxel by a step lie that step before it.
        before = voxel - neighbour(dr.maximum(opened, 1) - 1, width)
        is_opening &= covered.is_held(before)
        bucket = texel_from_voxel(before, level.resolution) + side * level.voxel_count
        first = dr.gather(mi.UInt32, buckets.starts, bucket, is_opening)
        after = dr.gather(mi.UInt32, buckets.starts, bucket + 1, is_opening)
        return (
            opened,
            dr.select(has_splat, entry + 1, first),
            dr.select(has_splat, end, after),
            added,
        )

    none = dr.zeros(mi.UInt32, lanes)
    start = [dr.zeros(mi.Int64, lanes) for _ in target.sums]
    _, _, _, collected = dr.while_loop(
        state=(none, mi.UInt32(none), mi.UInt32(none), start),
        cond=lambda number, entry, end, sums: number <= box_count,
        body=body,
        label="gather_splats",
    )
    place = dr.gather(mi.UInt32, target.place, texel) + (2 * axis + side) * target.count
    for sums, found in zip(target.sums, collected, strict=True):
        dr.scatter(sums, dr.gather(mi.Int64, sums, place) + found, place)
    dr.eval(target.sums)


def _sort(splats: Splats, level: LevelLayout, axis: int) -> _Buckets:
    """Sort splats that find opacity by counting; the order within a bucket does not matter."""
    slot_count = 2 * level.voxel_count
    side = splats.direction - 2 * axis
    slot = texel_from_voxel(splats.voxel, level.resolution) + side * level.voxel_count
    counts = dr.zeros(mi.UInt32, slot_count + 1)
    dr.scatter_reduce(
        dr.ReduceOp.Add, counts, mi.UInt32(1), slot, splats.is_seen, dr.ReduceMode.Direct
    )
    starts = mi.UInt32(dr.prefix_sum(counts))
    dr.eval(starts)
    taken = dr.zeros(mi.UInt32, slot_count)
    rank = mi.UInt32(dr.scatter_inc(taken, slot, splats.is_seen))
    order = dr.zeros(mi.UInt32, max(1, dr.width(splats.voxel)))
    number = dr.arange(mi.UInt32, dr.width(splats.voxel))
    dr.scatter(order, number, dr.gather(mi.UInt32, starts, slot) + rank, splats.is_seen)
    dr.eval(order)
    return _Buckets(order, starts)


def _lit_slots(target: Target, covered: CoveredSlots, axis: int) -> mi.UInt32:
    """Slots [side, voxel] of an axis that have opacity and are lit anew."""
    level = covered.level
    slot = dr.arange(mi.UInt32, 2 * level.voxel_count)
    held = dr.gather(mi.Float, covered.drawing, slot + 2 * axis * level.voxel_count)
    place = dr.gather(mi.UInt32, target.place, slot % level.voxel_count)
    return mi.UInt32(dr.compress((held > 0.0) & (place != NOWHERE)))
