"""Centre test: one texel for each covered slot, the nearest to the middle of its voxel.

The simplest algorithm of the talk holds the middle of a voxel against the shadow map: the texel
found there lights the whole voxel if it lies within it. Maps here are lists of lit points without a
grid, so the texel is looked for in the voxel itself. What follows is the same: a voxel is lit as a
whole or not at all, so light is false at the rims of shadows and objects and jumps from texel to
texel as things move.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.levels import LevelLayout
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection.splats import Splats
from vctgi.stages.light_injection.target import NOWHERE, Target

NONE = 0xFFFFFFFFFFFFFFFF
"""Key of a slot in which there is no texel."""

DISTANCE_STEPS = 2.0**31
"""Steps of the squared distance to the middle, which is below 1, squared voxels."""


def nearest_keys(target: Target) -> mi.UInt64:
    """Return a key [direction, place] for each slot of a target, of no texel."""
    return dr.full(mi.UInt64, NONE, dr.width(target.sums[0]))


def offer_splats(
    keys: mi.UInt64, target: Target, splats: Splats, first_texel: int, level: LevelLayout
) -> None:
    """Let splats compete for the slots that they lie in; texels count from `first_texel`."""
    texel = texel_from_voxel(splats.voxel, level.resolution)
    place = dr.gather(mi.UInt32, target.place, texel, splats.is_seen)
    distance = mi.UInt64(mi.Float64(dr.squared_norm(splats.offset)) * DISTANCE_STEPS)
    number = dr.arange(mi.UInt64, dr.width(splats.voxel)) + dr.opaque(mi.UInt64, first_texel)
    dr.scatter_reduce(
        dr.ReduceOp.Min,
        keys,
        distance * 2**32 + number,
        place + splats.direction * target.count,
        splats.is_seen & (place != NOWHERE),
        dr.ReduceMode.Direct,
    )


def radiance_of_keys(keys: mi.UInt64, maps: Sequence[ReflectiveShadowMap]) -> mi.Color3f:
    """Return the radiance of the texel that won each slot, 0 where there is none."""
    found = dr.zeros(mi.Color3f, dr.width(keys))
    first = 0
    for rsm in maps:
        assert rsm.radiance is not None, "injection asks for the radiance before it lights"
        begin = dr.opaque(mi.UInt32, first)
        number = mi.UInt32(keys & 0xFFFFFFFF) - begin
        is_own = (keys != NONE) & (number < dr.opaque(mi.UInt32, rsm.texel_count))
        found = dr.select(is_own, dr.gather(mi.Color3f, rsm.radiance, number, is_own), found)
        first += rsm.texel_count
    return found
