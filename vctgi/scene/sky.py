"""The environment as cones see it: its radiance, averaged over the directions of a cone.

The environment is kept as maps over polar angle and azimuth, two for each halving of the aperture.
The finest holds means over its own cells; every other one is the mean over a cone around each of
its directions, gathered from a map eight times finer. Reading interpolates between directions and
between apertures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.maths.constant_tables import number_table
from vctgi.maths.stub_gaps import as_component

LEAST_ROWS = 32
"""Rows of the coarsest maps: means over wide cones change slowly."""

ROWS_PER_APERTURE = 8
"""Rows of a map within the aperture that it is averaged over."""

CONE_SAMPLES = 64
"""Directions that a cone is averaged over, each as wide as an eighth of it."""

MAPS_PER_OCTAVE = 2
"""Maps for each halving of the aperture."""

SOURCE_STEP = 3 * MAPS_PER_OCTAVE
"""A cone is averaged over a map of 1 / 2^3 of its aperture."""

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True, kw_only=True)
class SkyConfig:
    """Resolution of the maps."""

    resolution: int = 256
    """Rows of the finest map, from pole to pole, a power of two in 16 .. 2048; narrower cones than
    two of them see it as blurred as that."""
    samples_per_edge: int = 8
    """Directions along an edge of a cell of the finest map that the emitter is asked for, >= 1."""

    def __post_init__(self) -> None:
        """Refuse maps that do not halve."""
        if not LEAST_ROWS <= self.resolution <= 2048 or self.resolution & (self.resolution - 1):
            raise ValueError(
                f"SkyConfig.resolution must be a power of two in {LEAST_ROWS} .. 2048, "
                f"got {self.resolution}."
            )
        if self.samples_per_edge < 1:
            raise ValueError(
                f"SkyConfig.samples_per_edge must be >= 1, got {self.samples_per_edge}."
            )


@dataclass
class PrefilteredSky:
    """Mean radiance over cones.

    Attributes
    ----------
    radiance
        All maps one after the other, [map, row, column], W m^-2 sr^-1. Map 0 is for cones of
        aperture pi, those after it for ever narrower ones, `MAPS_PER_OCTAVE` to each halving.
    rows
        Rows of each map; it has twice as many columns.
    """

    radiance: mi.Color3f
    rows: list[int]

    @property
    def offsets(self) -> list[int]:
        """First entry of each map."""
        return [sum(2 * n * n for n in self.rows[:number]) for number in range(len(self.rows))]

    def read(self, direction: mi.Vector3f, aperture: mi.Float) -> mi.Color3f:
        """Return the mean radiance over cones.

        Parameters
        ----------
        direction
            Unit axes, away from the point that looks.
        aperture
            Full apex angles, radians. Cones wider than pi are read as that, those narrower than
            the finest map's as that.
        """
        last = len(self.rows) - 1
        octaves = dr.log2(math.pi / aperture)
        wanted = dr.clip(MAPS_PER_OCTAVE * octaves, 0.0, float(last))
        wider = dr.minimum(mi.UInt32(wanted), max(last - 1, 0))
        rows, offsets = number_table(tuple(self.rows)), number_table(tuple(self.offsets))
        both = []
        for number in (wider, dr.minimum(wider + 1, last)):
            size = dr.gather(mi.UInt32, rows, number)
            start = dr.gather(mi.UInt32, offsets, number)
            both.append(_bilinear(self.radiance, start, size, direction))
        return dr.lerp(both[0], both[1], as_component(wanted - mi.Float(wider)))


def prefilter_sky(environment: mi.Emitter, config: SkyConfig) -> PrefilteredSky:
    """Average an environment over cones.

    Parameters
    ----------
    environment
        An emitter infinitely far away: constant, envmap, sunsky.
    config
        Resolution.

    Raises
    ------
    ValueError
        Its radiance is negative, infinite or no number somewhere.
    """
    rows = _rows_of_maps(config)
    finest = len(rows) - 1
    maps: list[mi.Color3f] = [_cell_means(environment, config)]
    for number in reversed(range(finest)):
        source = min(number + SOURCE_STEP, finest)
        held = maps[finest - source]
        aperture = math.pi / 2.0 ** (number / MAPS_PER_OCTAVE)
        maps.append(_cone_means(held, rows[source], rows[number], aperture))
    total = sum(2 * n * n for n in rows)
    radiance = dr.empty(mi.Color3f, total)
    sky = PrefilteredSky(radiance, rows)
    for values, start in zip(reversed(maps), sky.offsets, strict=True):
        dr.scatter(radiance, values, dr.arange(mi.UInt32, dr.width(values)) + start)
    dr.eval(radiance)
    is_light = (radiance >= 0.0) & dr.isfinite(radiance)
    if not bool(dr.all(is_light, axis=None)):
        raise ValueError(
            "prefilter_sky: the environment's radiance is negative, infinite or no number in some "
            "direction; correct its picture or its scale."
        )
    return sky


def black_sky(config: SkyConfig) -> PrefilteredSky:
    """Return what cones would look up that see nothing beyond the voxels."""
    rows = _rows_of_maps(config)
    return PrefilteredSky(dr.zeros(mi.Color3f, sum(2 * n * n for n in rows)), rows)


def _rows_of_maps(config: SkyConfig) -> list[int]:
    """Rows of each map; the finest is for cones as wide as two of its rows."""
    octaves = (config.resolution // 2).bit_length() - 1
    return [
        min(max(LEAST_ROWS, ROWS_PER_APERTURE << number // MAPS_PER_OCTAVE), config.resolution)
        for number in range(MAPS_PER_OCTAVE * octaves + 1)
    ]


def _direction(row: mi.Float, column: mi.Float, rows: int) -> mi.Vector3f:
    """Return the unit direction of a place in a map, in cells."""
    sin_theta, cos_theta = dr.sincos(row * (math.pi / rows))
    sin_phi, cos_phi = dr.sincos(column * (math.pi / rows))
    return mi.Vector3f(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)


def _cells(rows: int) -> tuple[mi.Float, mi.Float]:
    """Row and column of every cell of a map."""
    index = dr.arange(mi.UInt32, 2 * rows * rows)
    return mi.Float(index // (2 * rows)), mi.Float(index % (2 * rows))


def _cell_means(environment: mi.Emitter, config: SkyConfig) -> mi.Color3f:
    """Mean radiance over each cell of the finest map, by solid angle."""
    rows, edge = config.resolution, config.samples_per_edge
    row, column = _cells(rows)
    total = dr.zeros(mi.Color3f, 2 * rows * rows)
    weight = dr.zeros(mi.Float, 2 * rows * rows)
    for across in range(edge):
        for down in range(edge):
            # Opaque, so that all of them share one kernel.
            step = [dr.opaque(mi.Float, (each + 0.5) / edge) for each in (down, across)]
            direction = _direction(row + step[0], column + step[1], rows)
            share = dr.sin((row + step[0]) * (math.pi / rows))
            total += environment_radiance(environment, direction) * as_component(share)
            weight += share
            dr.eval(total, weight)
    return total / as_component(weight)


def environment_radiance(environment: mi.Emitter, direction: mi.Vector3f) -> mi.Color3f:
    """Radiance that an environment sends from unit directions, W m^-2 sr^-1."""
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(direction))
    si.wi = -direction
    return mi.Color3f(environment.eval(si))


def _cone_means(
    source: mi.Color3f, source_rows: int, target_rows: int, aperture: float
) -> mi.Color3f:
    """Mean over a cone around the middle of each cell of a map, from a finer map."""
    row, column = _cells(target_rows)
    frame = mi.Frame3f(_direction(row + 0.5, column + 0.5, target_rows))
    size, start = dr.opaque(mi.UInt32, source_rows), mi.UInt32(0)
    total = dr.zeros(mi.Color3f, dr.width(row))
    for local in cone_directions(aperture, CONE_SAMPLES):
        x, y, z = (dr.opaque(mi.Float, each) for each in local)
        direction = frame.to_world(mi.Vector3f(x, y, z))
        total += _bilinear(source, start, size, direction) / CONE_SAMPLES
        dr.eval(total)
    return total


def cone_directions(aperture: float, count: int) -> list[tuple[float, float, float]]:
    """Return unit directions spread evenly over a cone around +z, by solid angle, on a spiral."""
    found = []
    for number in range(count):
        cosine = 1.0 - (1.0 - math.cos(0.5 * aperture)) * (number + 0.5) / count
        sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
        phi = number * GOLDEN_ANGLE
        found.append((sine * math.cos(phi), sine * math.sin(phi), cosine))
    return found


def _bilinear(
    values: mi.Color3f, start: mi.UInt32, rows: mi.UInt32, direction: mi.Vector3f
) -> mi.Color3f:
    """Interpolate a map of some rows, whose first cell stands at `start`."""
    per_radian = mi.Float(rows) / math.pi
    columns = mi.Int32(2 * rows)
    down = dr.safe_acos(direction.z) * per_radian - 0.5
    across = dr.atan2(direction.y, direction.x) * per_radian - 0.5
    top, left = dr.floor(down), dr.floor(across)
    fraction = (mi.Float(down - top), mi.Float(across - left))
    total = mi.Color3f(0.0)
    for step_down in range(2):
        row = mi.Int32(top) + step_down
        # Beyond a pole lies the other side.
        is_beyond = (row < 0) | (row >= mi.Int32(rows))
        row = dr.clip(row, 0, mi.Int32(rows) - 1)
        for step_across in range(2):
            column = mi.Int32(left) + step_across + dr.select(is_beyond, mi.Int32(rows), 0)
            # Columns are a power of two: this wraps, below 0 too, and divides by nothing.
            column &= columns - 1
            share = (fraction[0] if step_down else 1.0 - fraction[0]) * (
                fraction[1] if step_across else 1.0 - fraction[1]
            )
            tap = dr.gather(mi.Color3f, values, start + mi.UInt32(row * columns + column))
            total = dr.fma(as_component(share), tap, total)
    return total
