"""Which slots of which voxels a point of a surface fills.

A slot belongs to one direction of travel and holds the surfaces that a ray travelling so meets from
their front: slot +x those whose normal has n_x < 0. Opacity and emittance follow the same rule, so
that light is only ever written where there is something to see.

A slanted plane crosses from one voxel to the next within a column and would let rays slip between
its parts; surfaces that are sloped against an axis are therefore thickened along it: a point fills
every voxel that a segment from it to a little behind the surface touches. Walls that face the axis
are left as thin as they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

BEHIND_NUDGE = 1e-3
"""How far behind the surface its voxel is looked up, in voxels, so that a wall that lies exactly on
a face between two voxels fills the one behind it, whatever the rounding."""

MAX_THICKNESS = 2.0
"""Thickest that a surface may be made, in voxels."""


@dataclass(frozen=True, kw_only=True)
class SlotRule:
    """How thick surfaces are made."""

    thickness_voxels: float = 1.0
    """Length of the segment behind a sloped surface whose voxels it fills, 0 .. 2."""
    sloped_below: float = 0.9
    """A surface is sloped against an axis when its normal's component along it is smaller, 0 .. 2:
    0 thickens nothing, above 1 everything."""

    def __post_init__(self) -> None:
        """Refuse a thickness that is none."""
        if not 0.0 <= self.thickness_voxels <= MAX_THICKNESS:
            raise ValueError(
                f"SlotRule.thickness_voxels must be in [0, {MAX_THICKNESS:g}], "
                f"got {self.thickness_voxels}."
            )
        if not 0.0 <= self.sloped_below <= 2.0:
            raise ValueError(f"SlotRule.sloped_below must be in [0, 2], got {self.sloped_below}.")

    @property
    def reach_voxels(self) -> float:
        """How far from a surface a voxel that it fills may lie, with the nudge behind it twice."""
        return self.thickness_voxels + 2.0 * BEHIND_NUDGE


DEFAULT_RULE = SlotRule()


@dataclass
class SurfaceSlot:
    """Where a surface point goes along one axis.

    Attributes
    ----------
    side
        0 where rays travelling towards +axis meet the front, else 1; slot = 2 * axis + side.
    behind
        -1 or +1: step along the axis that leads behind the surface.
    is_sloped
        Whether the surface is thickened along this axis.
    is_facing
        Whether the surface faces the axis at all.
    thickness
        Length of the segment behind the surface, voxels; 0 where it is not sloped.
    max_thickness
        Upper bound of `thickness` over all lanes.
    """

    side: mi.UInt32
    behind: mi.Int32
    is_sloped: mi.Bool
    is_facing: mi.Bool
    thickness: mi.Float
    max_thickness: float


def surface_slot(normal_component: mi.Float, rule: SlotRule = DEFAULT_RULE) -> SurfaceSlot:
    """Return the slot for a surface whose unit normal has this component along the axis."""
    faces_lower = normal_component < 0.0
    is_sloped = dr.abs(normal_component) < rule.sloped_below
    return SurfaceSlot(
        side=dr.select(faces_lower, mi.UInt32(0), mi.UInt32(1)),
        behind=dr.select(faces_lower, mi.Int32(1), mi.Int32(-1)),
        is_sloped=is_sloped,
        is_facing=normal_component != 0.0,
        thickness=dr.select(is_sloped, mi.Float(rule.thickness_voxels), 0.0),
        max_thickness=rule.thickness_voxels if rule.sloped_below > 0.0 else 0.0,
    )


def filled_layers(depth: mi.Float, slot: SurfaceSlot) -> Iterator[tuple[mi.Int32, mi.Bool]]:
    """Yield the layers of voxels along an axis that a surface point fills, nearest first.

    Parameters
    ----------
    depth
        Coordinate of the point along the axis, in voxels.
    slot
        Its slot along that axis.

    Yields
    ------
    tuple
        Layer, and the lanes that fill it. The first is filled by every lane that faces the axis.
    """
    behind = mi.Float(slot.behind)
    begin = depth + behind * BEHIND_NUDGE
    first = mi.Int32(dr.floor(begin))
    count = dr.abs(mi.Int32(dr.floor(begin + behind * slot.thickness)) - first)
    for step in range(math.ceil(slot.max_thickness) + 1):
        yield first + slot.behind * step, slot.is_facing & (step <= count)
