"""Where the labels of a scatter chart go, so that none covers another or a point."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

LETTER_SHARE = 0.58
"""Mean width of a letter over the size of the type, for the fonts of a page."""

POINT_RADIUS = 4.5
"""Half the square that a point takes, in points of type."""

REACHES = (7.0, 13.0, 21.0, 30.0, 40.0, 52.0, 66.0)
"""Distances from its point that are tried for a label, in points of type."""

DIRECTION_COUNT = 16
"""Directions that are tried at each distance, beginning on the right."""


@dataclass(frozen=True)
class Box:
    """An upright rectangle, points of type."""

    left: float
    bottom: float
    right: float
    top: float

    def overlaps(self, other: Box) -> bool:
        """Whether two rectangles share any area."""
        apart_x = self.right <= other.left or other.right <= self.left
        return not (apart_x or self.top <= other.bottom or other.top <= self.bottom)

    def is_inside(self, other: Box) -> bool:
        """Whether all of it lies in another."""
        is_wide = other.left <= self.left and self.right <= other.right
        return is_wide and other.bottom <= self.bottom and self.top <= other.top


@dataclass(frozen=True)
class LabelPlace:
    """Centre of a label, and whether it is so far from its point that a line must join them."""

    x: float
    y: float
    is_far: bool


def place_labels(
    points: Sequence[tuple[float, float]], names: Sequence[str], frame: Box, size: float
) -> list[LabelPlace | None]:
    """Place each name near its point, where it covers neither a point nor a name placed before.

    Parameters
    ----------
    points
        Of all marks, points of type; those after the last name only take room.
    names
        Labels of the first points.
    frame
        What the labels must lie in.
    size
        Of the type.

    Returns
    -------
    list
        A place for each name; None where there is no room.
    """
    marks = [Box(x - POINT_RADIUS, y - POINT_RADIUS, x + POINT_RADIUS, y + POINT_RADIUS)
             for x, y in points]  # fmt: skip
    taken = list(marks)
    places: list[LabelPlace | None] = []
    for (x, y), name in zip(points, names, strict=False):
        half_width, half_height = 0.5 * LETTER_SHARE * size * len(name), 0.6 * size
        place = None
        for dx, dy, reach in _offsets(half_width, half_height):
            box = Box(x + dx - half_width, y + dy - half_height,
                      x + dx + half_width, y + dy + half_height)  # fmt: skip
            if box.is_inside(frame) and not any(box.overlaps(other) for other in taken):
                place = LabelPlace(x + dx, y + dy, is_far=reach > REACHES[0])
                taken.append(box)
                break
        places.append(place)
    return places


def _offsets(half_width: float, half_height: float) -> Iterator[tuple[float, float, float]]:
    """Offsets of a label's centre, near ones first, with the distance of its rim."""
    for reach in REACHES:
        for number in range(DIRECTION_COUNT):
            # Right, then alternately above and below it, and left last.
            turn = (number + 1) // 2 * (1 if number % 2 else -1)
            angle = 2.0 * math.pi * turn / DIRECTION_COUNT
            dx, dy = math.cos(angle), math.sin(angle)
            yield dx * (reach + half_width), dy * (reach + half_height), reach
