"""Scatter: each splat adds its light to the slots that it touches."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.levels import LevelLayout
from vctgi.stages.light_injection.splats import (
    CoveredSlots,
    Splats,
    fixed_point,
    kernel_weight,
    neighbour,
)
from vctgi.stages.light_injection.target import NOWHERE, Target


def scatter_splats(target: Target, splats: Splats, covered: CoveredSlots, width: int) -> None:
    """Add splats to the sums of a target, in any order: the sums are of integers."""
    level = covered.level
    if width == 1:
        _add(target, splats, splats.voxel, None, level)
        return
    block = splats.direction * level.voxel_count

    def body(number: mi.UInt32) -> tuple[mi.UInt32]:
        step = neighbour(number, width)
        voxel = splats.voxel + step
        texel = texel_from_voxel(voxel, level.resolution)
        held = dr.gather(
            mi.Float, covered.drawing, texel + block, splats.is_seen & covered.is_held(voxel)
        )
        weight = kernel_weight(step, covered.taps) * held * splats.per_weight
        _add(target, splats, voxel, weight, level)
        return (number + 1,)

    dr.while_loop(
        state=(dr.zeros(mi.UInt32, dr.width(splats.voxel)),),
        cond=lambda number: number < width**3,
        body=body,
        labels=("number",),
        label="scatter_splats",
    )


def _add(
    target: Target,
    splats: Splats,
    voxel: mi.Vector3i,
    weight: mi.Float | None,
    level: LevelLayout,
) -> None:
    """Add the weighed light of each splat to one voxel."""
    is_lit = splats.is_seen if weight is None else splats.is_seen & (weight > 0.0)
    texel = texel_from_voxel(voxel, level.resolution)
    place = dr.gather(mi.UInt32, target.place, texel, is_lit)
    is_lit &= place != NOWHERE
    for sums, amount in zip(
        target.sums, fixed_point(splats.light, weight, target.device_steps), strict=True
    ):
        dr.scatter_reduce(
            dr.ReduceOp.Add,
            sums,
            amount,
            place + splats.direction * target.count,
            is_lit,
            dr.ReduceMode.Direct,
        )
