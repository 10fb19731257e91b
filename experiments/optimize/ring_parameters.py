"""Parameters of one number a ring: the cones of a ring differ by their azimuth alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from experiments.errors import InputError
from experiments.optimize.parameters import Parameter
from vctgi.config import RenderConfig
from vctgi.maths.cones import ring_sizes


@dataclass(frozen=True, kw_only=True)
class RingRule:
    """A parameter for each ring of cones."""

    field: str
    """What `DiffuseConesConfig` calls the numbers of each cone."""
    bounds: tuple[float, float]
    reason: str
    scale: float | None = None
    is_relative: bool = False
    """Whether only ratios count, so that the outermost ring stays as it is."""
    has_pole: bool = True
    """Whether the one cone of the pole takes part."""


RINGS = {
    "apertures": RingRule(
        field="cone_apertures",
        bounds=(0.1, 2.4),
        reason="radians: below, a ray that costs a step each quarter voxel; above, wider than a "
        "cone can be read",
    ),
    "weights": RingRule(
        field="cone_weights",
        bounds=(0.2, 5.0),
        reason="against the outermost ring; with more, a ring's cones are all that counts",
        is_relative=True,
    ),
    "elevations": RingRule(
        field="cone_elevations",
        bounds=(0.02, 1.5),
        reason="radians from the normal: between the pole and the horizon",
        scale=1.0,
        has_pole=False,
    ),
}
"""Parameters of one number a ring: the cones of a ring differ by their azimuth alone."""


def ring_parameters(name: str, config: RenderConfig) -> list[Parameter]:
    """Return the parameters of a name of `RINGS`, from the pole outwards.

    Raises
    ------
    InputError
        The cones of the configuration have no rings.
    """
    rule = RINGS[name]
    if config.diffuse.cone_set is not None:
        raise InputError(
            what=f"'{name}' means rings, and the cones of '{config.diffuse.cone_set}' have none",
            where="--parameters",
            remedy="start from a preset of our own",
        )
    rings = ring_sizes(config.diffuse.cone_count)
    found = []
    first = 0
    for number, size in enumerate(rings):
        is_pole = number == 0 and size == 1
        is_last = number == len(rings) - 1
        if not (is_pole and not rule.has_pole) and not (is_last and rule.is_relative):
            found.append(_ring_parameter(name, number, range(first, first + size)))
        first += size
    return found


def _ring_parameter(name: str, number: int, cones: range) -> Parameter:
    """Return the parameter of one ring."""
    rule = RINGS[name]
    place = cones[0]

    def read(config: RenderConfig) -> float:
        values = _cone_numbers(name, config)
        return values[place] / values[-1] if rule.is_relative else values[place]

    def write(config: RenderConfig, value: float) -> RenderConfig:
        values = list(_cone_numbers(name, config))
        new = value * values[-1] if rule.is_relative else value
        for cone in cones:
            values[cone] = new
        change: dict[str, Any] = {rule.field: tuple(values)}
        return replace(config, diffuse=replace(config.diffuse, **change))

    return Parameter(
        name=f"{name}[{number}]",
        low=rule.bounds[0],
        high=rule.bounds[1],
        reason=rule.reason,
        read=read,
        write=write,
        scale=rule.scale,
    )


def _cone_numbers(name: str, config: RenderConfig) -> tuple[float, ...]:
    """Return a number of each diffuse cone, before the common scale of the apertures."""
    cones = config.diffuse.cones()
    if name == "weights":
        return cones.weights
    if name == "elevations":
        return tuple(math.acos(min(1.0, z)) for _, _, z in cones.directions)
    return tuple(each / config.diffuse.aperture_scale for each in cones.apertures)
