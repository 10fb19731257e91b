"""What can be fitted: names, bounds with their reasons, and their place in a configuration.

An optimiser sees inner numbers of about unit size: the logarithm of what is positive, a share of
the scale of what may be 0 or negative.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from experiments.errors import InputError
from vctgi.config import RenderConfig
from vctgi.maths.cones import ring_sizes


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number of a configuration."""

    name: str
    """What the command line and the tables call it."""
    low: float
    """Lower bound."""
    high: float
    """Upper bound."""
    reason: str
    """Why these bounds."""
    read: Callable[[RenderConfig], float]
    """Takes it out of a configuration."""
    write: Callable[[RenderConfig, float], RenderConfig]
    """Returns a configuration with another value."""
    scale: float | None = None
    """What counts as a change of 1; None: the logarithm is fitted."""
    options: tuple[int, ...] | None = None
    """The only values of a discrete choice, which has no derivative; None: any in the bounds."""

    def inner(self, value: float) -> float:
        """Return the number that an optimiser sees."""
        return math.log(value) if self.scale is None else value / self.scale

    def outer(self, number: float) -> float:
        """Return the value, inside its bounds."""
        value = math.exp(number) if self.scale is None else number * self.scale
        if self.options is not None:
            return min(self.options, key=lambda option: abs(option - value))
        return min(max(value, self.low), self.high)

    @property
    def inner_bounds(self) -> tuple[float, float]:
        """Bounds of what an optimiser sees."""
        return self.inner(self.low), self.inner(self.high)


def write_point(
    config: RenderConfig, parameters: Sequence[Parameter], values: Sequence[float]
) -> RenderConfig:
    """Return a configuration with values of all parameters."""
    for parameter, value in zip(parameters, values, strict=True):
        config = parameter.write(config, value)
    return config


Read = Callable[[RenderConfig], float]
Write = Callable[[RenderConfig, float], RenderConfig]


def _march(name: str) -> tuple[Read, Write]:
    """Return how a number of the diffuse cones' march is read and written."""

    def read(config: RenderConfig) -> float:
        return float(getattr(config.diffuse.march, name))

    def write(config: RenderConfig, value: float) -> RenderConfig:
        change: dict[str, Any] = {name: value}
        march = replace(config.diffuse.march, **change)
        return replace(config, diffuse=replace(config.diffuse, march=march))

    return read, write


def _diffuse(name: str) -> tuple[Read, Write]:
    """Return how a number of the diffuse cones is read and written."""

    def read(config: RenderConfig) -> float:
        return float(getattr(config.diffuse, name))

    def write(config: RenderConfig, value: float) -> RenderConfig:
        change: dict[str, Any] = {name: value}
        return replace(config, diffuse=replace(config.diffuse, **change))

    return read, write


def _single(
    name: str,
    place: tuple[Read, Write],
    bounds: tuple[float, float],
    reason: str,
    scale: float | None = None,
) -> Parameter:
    low, high = bounds
    read, write = place
    return Parameter(
        name=name, low=low, high=high, reason=reason, read=read, write=write, scale=scale
    )


SINGLE = {
    each.name: each
    for each in (
        _single(
            "aperture_scale",
            _diffuse("aperture_scale"),
            (0.4, 1.8),
            "below, cones leave gaps of more than half the hemisphere; above, a neighbour's axis "
            "lies in every cone",
        ),
        _single(
            "step_ratio",
            _march("step_ratio"),
            (0.2, 1.0),
            "a larger step skips voxels; a smaller one changes nothing and costs in proportion",
        ),
        _single(
            "min_step",
            _march("min_step_voxels"),
            (0.1, 1.0),
            "the same, near the apex",
        ),
        _single(
            "start_offset",
            _march("start_offset_voxels"),
            (0.0, 4.0),
            "a cone starts on the surface; farther off than 4 voxels, contact shadows are gone",
            1.0,
        ),
        _single(
            "level_bias",
            _march("level_bias"),
            (-3.0, 1.0),
            "finer than an eighth of the footprint only aliases; coarser than twice it only leaks",
            1.0,
        ),
        _single(
            "exponent",
            _march("correction_factor"),
            (0.3, 3.0),
            "an exponent on what a step lets through: half and twice the opacity, with room",
        ),
        _single(
            "pull_back",
            _march("pull_back_voxels"),
            (0.0, 1.0),
            "more than a voxel reads what lies before the wall",
            1.0,
        ),
        _single(
            "near_field",
            _diffuse("near_field_voxels"),
            (0.5, 8.0),
            "real rays: below, they end before the first sample; above, they are ray tracing",
        ),
    )
}
"""Parameters of one number."""


def _write_cone_count(config: RenderConfig, value: float) -> RenderConfig:
    if round(value) == config.diffuse.cone_count:
        return config
    # What was set cone by cone belongs to the count before.
    diffuse = replace(
        config.diffuse,
        cone_count=round(value),
        cone_apertures=None,
        cone_weights=None,
        cone_elevations=None,
    )
    return replace(config, diffuse=diffuse)


def _write_sparsity(config: RenderConfig, value: float) -> RenderConfig:
    return replace(config, reconstruction=replace(config.reconstruction, sparsity=round(value)))


CHOICES = {
    each.name: each
    for each in (
        Parameter(
            name="cone_count",
            low=4,
            high=64,
            reason="counts whose rings are of about equal width",
            read=lambda config: config.diffuse.cone_count,
            write=_write_cone_count,
            scale=1.0,
            options=(4, 6, 9, 12, 16, 17, 24, 32, 48, 64),
        ),
        Parameter(
            name="sparsity",
            low=1,
            high=16,
            reason="the squares that sparse pixels know",
            read=lambda config: config.reconstruction.sparsity,
            write=_write_sparsity,
            scale=1.0,
            options=(1, 4, 9, 16),
        ),
    )
}
"""Discrete choices, which only Optuna makes."""


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


def parameter_names() -> list[str]:
    """Return all names that `find_parameters` takes."""
    return [*SINGLE, *RINGS, *CHOICES]


def find_parameters(names: Sequence[str], config: RenderConfig) -> list[Parameter]:
    """Return the parameters that are named, one for each ring where a name means rings.

    Raises
    ------
    InputError
        A name that does not exist, is given twice, or does not fit the configuration.
    """
    found: list[Parameter] = []
    for name in dict.fromkeys(names):
        if name in SINGLE or name in CHOICES:
            found.append(_fitting({**SINGLE, **CHOICES}[name], config))
        elif name in RINGS:
            found += _ring_parameters(name, config)
        else:
            raise InputError(
                what=f"there is no parameter '{name}'",
                where="--parameters",
                remedy=f"use {', '.join(parameter_names())}",
            )
    if not found:
        raise InputError(what="no parameter is named", where="--parameters", remedy="name one")
    # A count resets what is set cone by cone, so choices are written first.
    return sorted(found, key=lambda each: each.options is None)


def _fitting(parameter: Parameter, config: RenderConfig) -> Parameter:
    """Return a parameter whose start lies in its bounds, or refuse it."""
    value = parameter.read(config)
    is_option = parameter.options is None or value in parameter.options
    if not (parameter.low <= value <= parameter.high and is_option):
        raise InputError(
            what=f"'{parameter.name}' is {value:g} in the preset, outside of "
            f"{parameter.low:g} .. {parameter.high:g} ({parameter.reason})",
            where="--parameters",
            remedy="leave it out, or start from another preset",
        )
    return parameter


def _ring_parameters(name: str, config: RenderConfig) -> list[Parameter]:
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
            found.append(
                _fitting(_ring_parameter(name, number, range(first, first + size)), config)
            )
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
