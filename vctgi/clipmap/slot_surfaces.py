"""The surfaces behind the slots of a level: a list of the slots that hold any."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import LevelLayout


@dataclass
class SlotSurfaces:
    """Slots of one clip level that have opacity and no finer voxels in their place.

    Attributes
    ----------
    level
        The level.
    index
        Place of each slot among the level's texels [direction, z, y, x].
    opacity
        Its opacity, (0, 1].
    position
        Mean world point of the surfaces in it.
    normal
        Their mean unit normal.
    albedo
        Their mean albedo, [0, 1]; 0 where no point of a surface is known.
    unknown_share
        Share of the opacity of all these slots in which no point of a surface was found.
    """

    level: LevelLayout
    index: mi.UInt32
    opacity: mi.Float
    position: mi.Point3f
    normal: mi.Vector3f
    albedo: mi.Color3f
    unknown_share: float

    @property
    def count(self) -> int:
        """Number of slots."""
        return int(dr.width(self.index))
