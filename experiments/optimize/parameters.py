"""What can be fitted: names, bounds with their reasons, and their place in a configuration.

An optimiser sees inner numbers of about unit size: the logarithm of what is positive, a share of
the scale of what may be 0 or negative.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from vctgi.clipmap.texel_choice import Filtering
from vctgi.config import RenderConfig


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
        return _with_march(config, **{name: value})

    return read, write


def _with_march(config: RenderConfig, **changes: Any) -> RenderConfig:
    """Return a configuration whose diffuse cones march otherwise."""
    march = replace(config.diffuse.march, **changes)
    return replace(config, diffuse=replace(config.diffuse, march=march))


def _diffuse(name: str) -> tuple[Read, Write]:
    """Return how a number of the diffuse cones is read and written."""

    def read(config: RenderConfig) -> float:
        return float(getattr(config.diffuse, name))

    def write(config: RenderConfig, value: float) -> RenderConfig:
        change: dict[str, Any] = {name: value}
        return replace(config, diffuse=replace(config.diffuse, **change))

    return read, write


def _read_contrast(config: RenderConfig) -> float:
    held = config.reconstruction.max_contrast
    # No limit is one that no light reaches, and lies outside of the bounds.
    return math.inf if held is None else held


def _write_contrast(config: RenderConfig, value: float) -> RenderConfig:
    return replace(config, reconstruction=replace(config.reconstruction, max_contrast=value))


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
        _single(
            "ring_jitter",
            _diffuse("ring_jitter"),
            (0.0, 1.0),
            "a share: at 1 axes fill the hemisphere evenly",
            1.0,
        ),
        _single(
            "max_contrast",
            (_read_contrast, _write_contrast),
            (0.15, 1.5),
            "below, the noise of the cones refines every ray; above, hardly any light deviates",
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
        cone_azimuths=None,
    )
    return replace(config, diffuse=diffuse)


def _write_sparsity(config: RenderConfig, value: float) -> RenderConfig:
    return replace(config, reconstruction=replace(config.reconstruction, sparsity=round(value)))


def _write_traced_once(config: RenderConfig, value: float) -> RenderConfig:
    is_once = bool(round(value))
    return replace(config, reconstruction=replace(config.reconstruction, is_traced_once=is_once))


def _read_filtering(config: RenderConfig) -> float:
    return get_args(Filtering).index(config.diffuse.march.filtering)


def _write_filtering(config: RenderConfig, value: float) -> RenderConfig:
    return _with_march(config, filtering=get_args(Filtering)[round(value)])


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
            options=(4, 6, 9, 12, 16, 17, 20, 24, 28, 32, 40, 48, 64),
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
        Parameter(
            name="traced_once",
            low=0,
            high=1,
            reason="no or yes: whether the further camera rays of a pixel trace none of their own",
            read=lambda config: int(config.reconstruction.is_traced_once),
            write=_write_traced_once,
            scale=1.0,
            options=(0, 1),
        ),
        Parameter(
            name="filtering",
            low=0,
            high=2,
            reason=f"in the order of {', '.join(get_args(Filtering))}",
            read=_read_filtering,
            write=_write_filtering,
            scale=1.0,
            options=(0, 1, 2),
        ),
    )
}
"""Discrete choices, which have no derivatives."""
