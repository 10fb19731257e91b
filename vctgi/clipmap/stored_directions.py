"""Which directions of travel a volume stores, and where.

Six one-sided slots a voxel are what the stages work on. Directions that no surface faces hold
nothing and need not be stored, those that all hold the same are stored once, and formats for
comparison store three or one.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import LevelTexels
from vctgi.clipmap.neighbourhood import Layer
from vctgi.maths.directions import DIRECTION_COUNT


@dataclass(frozen=True)
class StoredDirections:
    """Where each direction is stored.

    Attributes
    ----------
    slots
        [direction +x -x +y -y +z -z] place among the stored ones, None for what is always empty.
    """

    slots: tuple[int | None, ...]

    @property
    def count(self) -> int:
        """Stored directions, at least one."""
        return 1 + max((slot for slot in self.slots if slot is not None), default=0)

    @property
    def sources(self) -> list[int]:
        """For each stored direction the first of the six that it holds."""
        found = {slot: direction for direction, slot in reversed(list(enumerate(self.slots)))}
        return [found.get(slot, 0) for slot in range(self.count)]

    def has_axis(self, axis: int) -> bool:
        """Whether any voxel holds something for travel along an axis."""
        return self.slots[2 * axis] is not None or self.slots[2 * axis + 1] is not None

    def find(self, layer: Layer) -> tuple[mi.UInt32 | int, mi.Bool | bool]:
        """Return the stored place of a layer's direction, and the lanes that have one."""
        lower, upper = self.slots[2 * layer.axis : 2 * layer.axis + 2]
        if lower is None or upper is None:
            return (lower or upper or 0), layer.side == (1 if lower is None else 0)
        if lower == upper:
            return lower, True
        return lower + layer.side * (upper - lower), True


def directions_of(count: int) -> StoredDirections:
    """Return the layout of 6, 3 or 1 directions."""
    return StoredDirections(
        tuple(direction * count // DIRECTION_COUNT for direction in range(DIRECTION_COUNT))
    )


SIX = directions_of(DIRECTION_COUNT)
"""Every direction for itself."""

SAME = directions_of(1)
"""One for all, where all six hold the same."""


def facing_directions(faced: tuple[bool, ...]) -> StoredDirections:
    """Return the layout that stores the directions which some surface faces."""
    slots: list[int | None] = []
    for direction in range(DIRECTION_COUNT):
        slots.append(sum(faced[:direction]) if faced[direction] else None)
    return StoredDirections(tuple(slots))


def select_directions(texels: LevelTexels, directions: StoredDirections) -> LevelTexels:
    """Return the stored ones of a level's six directions."""
    sources = directions.sources
    if sources == list(range(DIRECTION_COUNT)):
        return texels
    voxel_count = dr.width(texels.opacity) // DIRECTION_COUNT
    lane = dr.arange(mi.UInt32, len(sources) * voxel_count)
    width = dr.opaque(mi.UInt32, voxel_count)
    source = dr.gather(mi.UInt32, mi.UInt32(sources), lane // width) * width + lane % width
    return LevelTexels(
        dr.gather(mi.Color3f, texels.emittance, source),
        dr.gather(mi.Float, texels.opacity, source),
        len(sources),
    )
