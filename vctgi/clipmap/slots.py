"""Which slots of which voxels a point of a surface fills.

A slot belongs to one direction of travel and holds the surfaces that a ray travelling so meets from
their front: slot +x those whose normal has n_x < 0. Opacity and emittance follow the same rule, so
that light is only ever written where there is something to see.

A slanted plane crosses from one voxel to the next within a column and would let rays slip between
its parts; surfaces that are sloped against an axis therefore also fill the voxel behind. Walls that
face the axis are left as thin as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

SLOPED_BELOW = 0.9
"""A surface is sloped against an axis when its normal's component along it is smaller."""

BEHIND_NUDGE = 1e-3
"""How far behind the surface its voxel is looked up, in voxels, so that a wall that lies exactly on
a face between two voxels fills the one behind it, whatever the rounding."""


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
        Whether the voxel behind is filled as well.
    is_facing
        Whether the surface faces the axis at all.
    """

    side: mi.UInt32
    behind: mi.Int32
    is_sloped: mi.Bool
    is_facing: mi.Bool


def surface_slot(normal_component: mi.Float) -> SurfaceSlot:
    """Return the slot for a surface whose unit normal has this component along the axis."""
    faces_lower = normal_component < 0.0
    return SurfaceSlot(
        side=dr.select(faces_lower, mi.UInt32(0), mi.UInt32(1)),
        behind=dr.select(faces_lower, mi.Int32(1), mi.Int32(-1)),
        is_sloped=dr.abs(normal_component) < SLOPED_BELOW,
        is_facing=normal_component != 0.0,
    )
