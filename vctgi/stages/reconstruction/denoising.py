"""The filter of noisy specular cones: a kernel of 4x4 pixels that stops at edges.

Specular cones that start at one of 16 phases, in a pattern that repeats every 4x4 pixels, show
noise in the place of bands. Any 4x4 pixels hold each phase once, so their mean is free of it. The
kernel here is centred: 5x5 taps whose outermost count half, along each axis the weights 1/8, 1/4,
1/4, 1/4, 1/8. Taps that are four pixels apart have the same phase, so each phase still weighs 1/16.
Beyond the rim of the picture, a tap is taken four pixels further in, for the same reason.

What is filtered is what cones see, before the surface's reflectance multiplies it, so texture stays
sharp. The filter runs on one sample of each pixel, whose surface is known exactly; pictures of
several samples a pixel are means of filtered ones. A pixel at the edge of an object is therefore
filtered with like samples on either side of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi

from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import GBuffer

SpecularFilter = Literal["none", "box4", "bilateral"]
"""What is done about noise: nothing, the mean over all neighbours, or over like neighbours."""

PERIOD = 4
"""Pixels after which the pattern of phases repeats."""

TAPS = PERIOD + 1
"""Taps along an axis of the kernel."""


@dataclass(frozen=True, kw_only=True)
class SpecularFilterConfig:
    """How specular cones are filtered; the widths belong to "bilateral" alone.

    A neighbour's weight falls off as a Gaussian of each difference, of these standard deviations.
    """

    kind: SpecularFilter = "none"
    """ "none", "box4" (for comparison: it crosses edges) or "bilateral"."""
    normal_width: float = 0.2
    """Distance between unit normals, > 0."""
    plane_width: float = 0.1
    """Sine of the angle between the way to the neighbour and the surface, > 0."""
    axis_width: float = 0.5
    """Angle between the cones' axes over the narrower cone's aperture, > 0; it keeps what mirrors
    show sharp, as far as pixels are wide against the cone."""
    roughness_width: float = 0.5
    """Logarithm of the ratio of the apertures, > 0."""

    def __post_init__(self) -> None:
        """Refuse filters that do not exist and widths that let nothing through."""
        if self.kind not in get_args(SpecularFilter):
            raise ValueError(
                f"SpecularFilterConfig.kind must be one of {get_args(SpecularFilter)}, "
                f"got {self.kind!r}."
            )
        for name in ("normal_width", "plane_width", "axis_width", "roughness_width"):
            if not getattr(self, name) > 0.0:
                raise ValueError(
                    f"SpecularFilterConfig.{name} must be > 0, got {getattr(self, name)}."
                )


def filter_specular(
    radiance: mi.Color3f,
    gbuffer: GBuffer,
    film_width: int,
    least_aperture: float,
    config: SpecularFilterConfig,
) -> mi.Color3f:
    """Average what specular cones see over like neighbours.

    Weights are normalised at each pixel, so what is constant stays so.

    Parameters
    ----------
    radiance
        What the cone of each pixel sees, W m^-2 sr^-1; lane `y * film_width + x`.
    gbuffer
        One sample of each pixel.
    film_width
        Pixels in a row.
    least_aperture
        Of the cones that were traced, radians.
    config
        Kind and widths.

    Returns
    -------
    mi.Color3f
        The same where no specular cone was traced.
    """
    if config.kind == "none":
        return radiance
    width = dr.width(gbuffer.position)
    film_height = width // film_width
    pixel = dr.arange(mi.UInt32, width)
    place = mi.Point2i(mi.Int32(pixel % film_width), mi.Int32(pixel // film_width))
    is_reflecting = gbuffer.is_valid & (dr.max(gbuffer.specular_albedo) > 0.0)
    here = _Surface.of(gbuffer, least_aperture)
    dr.eval(here, radiance, is_reflecting)
    is_bilateral = config.kind == "bilateral"
    widths = config.normal_width, config.plane_width, config.axis_width, config.roughness_width

    def add_tap(
        number: mi.UInt32, total: mi.Color3f, total_weight: mi.Float
    ) -> tuple[mi.UInt32, mi.Color3f, mi.Float]:
        offset_x, kernel_x = _tap(number % TAPS)
        offset_y, kernel_y = _tap(number // TAPS)
        x, inside_x = _folded(place.x + offset_x, film_width)
        y, inside_y = _folded(place.y + offset_y, film_height)
        active = is_reflecting & inside_x & inside_y
        index = mi.UInt32(dr.select(active, y * film_width + x, 0))
        active &= dr.gather(mi.Bool, is_reflecting, index)
        weight = kernel_x * kernel_y
        if is_bilateral:
            weight *= _likeness(here, dr.gather(_Surface, here, index), widths)
        weight = dr.select(active, weight, 0.0)
        found = dr.gather(mi.Color3f, radiance, index)
        total = total + dr.select(active, as_component(weight) * found, 0.0)
        return number + 1, total, total_weight + weight

    _, total, total_weight = dr.while_loop(
        state=(
            dr.zeros(mi.UInt32, width),
            dr.zeros(mi.Color3f, width),
            dr.zeros(mi.Float, width),
        ),
        cond=lambda number, *_: number < TAPS * TAPS,
        body=add_tap,
        labels=("number", "total", "total_weight"),
        label="filter_specular",
        # A sum of taps that do not know each other needs no memory of them in reverse mode.
        max_iterations=-1,
    )
    mean = total / as_component(dr.select(is_reflecting, total_weight, 1.0))
    return dr.select(is_reflecting, mean, radiance)


@dataclass
class _Surface:
    """What tells neighbours apart, of each pixel."""

    position: mi.Point3f
    normal: mi.Vector3f
    axis: mi.Vector3f
    aperture: mi.Float

    @classmethod
    def of(cls, gbuffer: GBuffer, least_aperture: float) -> _Surface:
        return cls(
            mi.Point3f(gbuffer.position),
            mi.Vector3f(gbuffer.normal),
            mi.Vector3f(gbuffer.specular_axis),
            dr.maximum(gbuffer.specular_aperture, least_aperture),
        )


def _likeness(
    here: _Surface, there: _Surface, widths: tuple[float, float, float, float]
) -> mi.Float:
    """Weight of a neighbour, (0, 1], the same in both directions."""
    normal_width, plane_width, axis_width, roughness_width = widths
    way = mi.Vector3f(there.position - here.position)
    distance = dr.norm(way)
    rise_here, rise_there = (mi.Float(dr.dot(way, each.normal)) for each in (here, there))
    off_plane = dr.maximum(dr.abs(rise_here), dr.abs(rise_there))
    sine = dr.select(distance > 0.0, off_plane / dr.select(distance > 0.0, distance, 1.0), 0.0)
    narrower = dr.minimum(here.aperture, there.aperture)
    exponent = (
        dr.squared_norm(there.normal - here.normal) / normal_width**2
        + dr.square(sine / plane_width)
        + dr.squared_norm(there.axis - here.axis) / dr.square(narrower * axis_width)
        + dr.square(dr.log(there.aperture / here.aperture) / roughness_width)
    )
    return mi.Float(dr.exp(-0.5 * exponent))


def _tap(number: mi.UInt32) -> tuple[mi.Int32, mi.Float]:
    """Offset in pixels and weight of a tap along one axis."""
    offset = mi.Int32(number) - PERIOD // 2
    return offset, dr.select(dr.abs(offset) == PERIOD // 2, 0.5, mi.Float(1.0)) / PERIOD


def _folded(place: mi.Int32, count: int) -> tuple[mi.Int32, mi.Bool]:
    """Return a place inside the picture with the same phase, and whether there is one."""
    folded = dr.select(place < 0, place + PERIOD, place)
    folded = dr.select(folded >= count, folded - PERIOD, folded)
    return folded, (folded >= 0) & (folded < count)
