"""Which cone of which point each lane traces.

Neighbouring lanes share caches, and a GPU's run in step. All cones of a point start in one place,
so their rays meet the same part of the scene and their first samples the same voxels; the same cone
of neighbouring points is about as long. So a few points take turns: all of them trace their first
cone, then their second one, and so on, and then come the next few. How many was measured
(docs/decisions/0029).
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

BLOCK = 4
"""Points that take turns."""

LONG_BLOCK = 256
"""The same of cones without real rays on a GPU, which hides how long memory takes: there it counts
more that neighbouring lanes march as long as one another."""


@dataclass
class ConeLanes:
    """Cones of points, one a lane.

    Attributes
    ----------
    point, cone
        Which point a lane belongs to, and which cone of its set it is.
    is_used
        Whether there is such a point: the last block may lack some, whose lanes are the last's.
    """

    point: mi.UInt32
    cone: mi.UInt32
    is_used: mi.Bool


@dataclass(frozen=True)
class LaneOrder:
    """The order in which lanes trace the cones of points.

    Attributes
    ----------
    cone_count
        Cones of each point.
    block
        Points that take turns.
    """

    cone_count: int
    block: int

    @classmethod
    def of(cls, cone_count: int, near_field_voxels: float) -> LaneOrder:
        """Return the fastest order of cones that begin with rays of some length, or none."""
        is_gpu = dr.backend_v(mi.Float) == dr.JitBackend.CUDA
        return cls(cone_count, LONG_BLOCK if is_gpu and near_field_voxels == 0.0 else BLOCK)

    def deal(self, point_count: int) -> ConeLanes:
        """Return the cones of so many points, > 0."""
        size = self.block * self.cone_count
        lane = dr.arange(mi.UInt32, -(-point_count // self.block) * size)
        point = lane // size * self.block + lane % self.block
        is_used = mi.Bool(True) if point_count % self.block == 0 else point < point_count
        return ConeLanes(dr.minimum(point, point_count - 1), lane % size // self.block, is_used)

    def lane_of(self, point: mi.UInt32, cone: int) -> mi.UInt32:
        """Return the lane that traces a cone of each point."""
        first = point // self.block * (self.block * self.cone_count)
        return first + (cone * self.block + point % self.block)


def cone_after_cone(point_count: int, cone_count: int) -> LaneOrder:
    """Return the first cones of all points, then all second ones: a table [cone, point]."""
    return LaneOrder(cone_count, point_count)
