"""The stages that can be made exact, and the two orders in which they are."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, kw_only=True)
class Exact:
    """Which stages of the renderer are replaced by their exact counterpart.

    The order of the fields is the forward order. Every subset is a renderer that can be run.
    """

    storage: bool = False
    """Voxels are stored in 32-bit floats."""
    light: bool = False
    """Slots hold the mean outgoing radiance of their surfaces, path-traced, in place of what light
    maps bring."""
    dense: bool = False
    """Every camera ray gathers light of its own, in place of interpolating that of sparse ones."""
    pixels: bool = False
    """Camera rays at random places of every pixel, each with light of its own, in place of a few
    at fixed places: the whole pixel."""
    width: bool = False
    """Hair-thin rays spread over the solid angle of a cone, in place of the cone."""
    directions: bool = False
    """Directions from the whole hemisphere, by the cosine, in place of those of the set."""
    visibility: bool = False
    """The first surface along real rays over the cone's solid angle, and the radiance of its own
    voxel, in place of the march: exact coverage, exact place."""
    radiance: bool = False
    """Adds, for the first surface along such a ray, its path-traced radiance less that of its
    voxel. With exact visibility that is path tracing."""


STAGES: tuple[str, ...] = tuple(field.name for field in fields(Exact))
"""Their names, in the forward order."""

STAGE_TITLES = {
    "storage": "storage in 32 bits",
    "light": "light maps",
    "dense": "sparse pixels",
    "pixels": "few rays a pixel",
    "width": "width of cones",
    "directions": "directions of cones",
    "visibility": "visibility by voxels",
    "radiance": "radiance of voxels",
}
"""What a stage is called in tables."""


def first_exact(count: int) -> Exact:
    """Return the renderer whose first `count` stages are exact."""
    return Exact(**dict.fromkeys(STAGES[:count], True))


def last_exact(count: int) -> Exact:
    """Return the renderer whose last `count` stages are exact."""
    return Exact(**dict.fromkeys(STAGES[len(STAGES) - count :], True))
