"""Specular cones: one along each visible point's mean glossy lobe, one straight through it.

Every pixel traces its own. All cones of a picture that start alike sample the voxels at the same
distances, which shows as bands where steps are long; so each takes another share of its first step.
The shares are random, or the 16 of a 4x4 pattern bound to the pixels, whose mean over any 4x4
pixels holds each share once (`vctgi.stages.reconstruction.denoising` takes it).

Fine lobes take one cone. One cone as wide as a rough lobe would see little but the surface that it
starts at, and mean what lies along its axis with what lies far beside it; so rough lobes are split
into a cone in the middle and a ring of cones around it, which cover the same solid angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.clipmap.texel_choice import random_choice
from vctgi.maths.constant_tables import number_table
from vctgi.maths.directions import random_unit
from vctgi.maths.evaluation import with_boundary
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.stages.cone_tracing.march import march_cone
from vctgi.stages.cone_tracing.packed_lanes import pack_lanes
from vctgi.stages.cone_tracing.specular_config import PhaseNoise as PhaseNoise
from vctgi.stages.cone_tracing.specular_config import SpecularConesConfig as SpecularConesConfig
from vctgi.stages.cone_tracing.specular_config import specular_march as specular_march
from vctgi.stages.cone_tracing.tally import SampleTally

WIDEST_CONE = 0.95 * math.pi
"""Aperture at which a cone becomes a half space and its footprint infinite; wider lobes are traced
as a cone of this one."""


BLUE_NOISE = (
    *(12, 4, 7, 3),
    *(1, 10, 14, 9),
    *(13, 6, 2, 5),
    *(8, 0, 11, 15),
)
"""Ranks of the 16 phases in rows of four pixels: found by annealing, so that phases close to each
other, also across the pattern's rim and from the last to the first, lie far apart."""

PATTERN_EDGE = 4
"""Pixels along an edge of the pattern."""

SAMPLE_TURN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Share of a step by which the pattern is shifted from one sample of a pixel to the next."""


@dataclass
class SpecularLight:
    """What the specular cones of each point see, W m^-2 sr^-1.

    Attributes
    ----------
    reflected
        Mean radiance over the cone of its glossy lobes; 0 where it has none.
    passed
        Radiance straight behind it; 0 where it lets nothing through.
    """

    reflected: mi.Color3f
    passed: mi.Color3f

    def towards_viewer(self, gbuffer: GBuffer) -> mi.Color3f:
        """Return the radiance that reaches the viewer, W m^-2 sr^-1."""
        reflected = gbuffer.specular_albedo * self.reflected
        return mi.Color3f(reflected + gbuffer.passed * self.passed)


def trace_specular(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: SpecularConesConfig,
    *,
    has_specular: bool,
    has_passing: bool,
    sky: PrefilteredSky | None = None,
    film: FilmSample | None = None,
    tally: SampleTally | None = None,
) -> SpecularLight:
    """Gather the light that glossy lobes reflect, and that masks and thin glass let through.

    Parameters
    ----------
    gbuffer
        Visible points with their lobes.
    volume
        Lit voxels.
    config
        March, noise and narrowest cone.
    has_specular, has_passing
        Which of the two cones the scene needs.
    sky
        What the share of a cone sees that nothing stops; None: darkness.
    film
        Where the points lie in the picture, which noise of kind "blue" needs.
    tally
        Counts what the cones read; None: nothing is counted.

    Raises
    ------
    ValueError
        Blue noise for points that have no place in a picture.
    """
    trace = _Tracing(volume, config, sky, tally)
    width = dr.width(gbuffer.position)
    reflected = passed = dr.zeros(mi.Color3f, width)
    points = _Points(
        position=gbuffer.position,
        normal=gbuffer.normal,
        axis=gbuffer.specular_axis,
        aperture=gbuffer.specular_aperture,
        noise=_noise(gbuffer, config, film) + dr.zeros(mi.Float, width),
        sample_index=gbuffer.sample_index,
        is_traced=gbuffer.is_valid & (dr.max(gbuffer.specular_albedo) > 0.0),
    )
    if has_specular:
        reflected = _trace_lobe(points, trace)
    if has_passing:
        straight = replace(
            points,
            axis=gbuffer.ray_direction,
            is_traced=gbuffer.is_valid & (dr.max(gbuffer.passed) > 0.0),
        )
        passed = trace(straight, lambda points: _straight(points, config))
    return SpecularLight(reflected, passed)


@dataclass
class _Points:
    """Where cones start, one a lane, and what tells them apart.

    Attributes
    ----------
    position, normal
        Of the surface.
    axis, aperture
        Mean direction of its lobe, and the full apex angle of that.
    noise
        Of which the fraction counts.
    sample_index
        Chooses random numbers.
    is_traced
        Whether it has a lobe.
    """

    position: mi.Point3f
    normal: mi.Vector3f
    axis: mi.Vector3f
    aperture: mi.Float
    noise: mi.Float
    sample_index: mi.UInt32
    is_traced: mi.Bool


@dataclass
class _Cone:
    """One cone a lane.

    Attributes
    ----------
    axis, aperture
        Unit direction and full apex angle.
    number
        Which of its point's cones it is.
    noise
        Of which the fraction is left out of its first step.
    is_traced
        Whether there is one.
    """

    axis: mi.Vector3f
    aperture: mi.Float
    number: mi.UInt32
    noise: mi.Float
    is_traced: mi.Bool


def _straight(points: _Points, config: SpecularConesConfig) -> _Cone:
    """Return the cones straight through surfaces."""
    aperture, number = mi.Float(config.min_aperture), mi.UInt32(PASSING)
    return _Cone(points.axis, aperture, number, points.noise, points.is_traced)


def _trace_lobe(points: _Points, trace: _Tracing) -> mi.Color3f:
    """Mean radiance over each point's lobe."""
    config, count = trace.config, trace.config.rough_cone_count
    width = dr.width(points.position)
    total, total_weight = dr.zeros(mi.Color3f, width), dr.zeros(mi.Float, width)
    for number in range(count):
        # Opaque, so that all cones share one kernel.
        place = mi.UInt32(0) if count == 1 else dr.opaque(mi.UInt32, number)

        def cone_of(points: _Points, place: mi.UInt32 = place) -> _Cone:
            return _part_of_lobe(points, place, config)

        part = with_boundary(points)
        seen = trace(part, cone_of)
        if count == 1:
            return seen
        total += seen
        total_weight += dr.select(cone_of(part).is_traced, 1.0, mi.Float(0.0))
        dr.eval(total, total_weight)
    return mi.Color3f(total / as_component(dr.maximum(total_weight, 1.0)))


def _part_of_lobe(points: _Points, number: mi.UInt32, config: SpecularConesConfig) -> _Cone:
    """Return one of the cones that share a lobe evenly: number 0 in the middle, a ring of others.

    Up to `rough_aperture` all of them are the lobe, so that no seam shows where it is crossed; of
    lobes below it only the first is traced.
    """
    aperture = points.aperture
    if config.aperture_scale != 1.0:
        aperture = aperture * config.aperture_scale
    # A lobe that is wider than a cone can be ends at WIDEST_CONE.
    aperture = mi.Float(dr.clip(aperture, config.min_aperture, WIDEST_CONE))
    count, noise = config.rough_cone_count, points.noise
    if count == 1:
        return _Cone(points.axis, aperture, number, noise, points.is_traced)
    parting = dr.clip(aperture / config.rough_aperture - 1.0, 0.0, 1.0)
    height = 1.0 - dr.cos(0.5 * aperture)
    part = 2.0 * dr.acos(1.0 - height / count)
    # The ring holds the shares from 1 / count to 1; half of its light lies within their mean.
    from_axis = parting * dr.acos(1.0 - height * (0.5 + 0.5 / count))
    from_axis = dr.select(number == 0, 0.0, from_axis)
    turn = (mi.Float(number) + noise) / (count - 1)
    axis_sine, axis_cosine = dr.sincos(from_axis)
    sine, cosine = dr.sincos(2.0 * math.pi * turn)
    local = mi.Vector3f(axis_sine * cosine, axis_sine * sine, axis_cosine)
    axis = mi.Vector3f(mi.Frame3f(points.axis).to_world(local))
    is_rough = (aperture > config.rough_aperture) & (dr.dot(axis, points.normal) > 0.0)
    return _Cone(
        axis=axis,
        aperture=mi.Float(dr.lerp(aperture, part, parting)),
        number=number,
        noise=noise + SAMPLE_TURN * mi.Float(number),
        is_traced=points.is_traced & ((number == 0) | is_rough),
    )


def _noise(gbuffer: GBuffer, config: SpecularConesConfig, film: FilmSample | None) -> mi.Float:
    """Return what tells the cones of points apart, of which the fraction counts, >= 0."""
    offset = dr.opaque(mi.Float, config.phase_offset)
    if config.noise == "random":
        return mi.Float(offset + random_unit(gbuffer.sample_index, PHASE_STREAM))
    if config.noise == "none":
        return offset
    if film is None:
        raise ValueError(
            'trace_specular: noise "blue" is bound to pixels, and these points have none: '
            'pass `film`, or set SpecularConesConfig.noise to "random".'
        )
    return mi.Float(offset + blue_noise_phase(film, dr.width(gbuffer.position)))


def blue_noise_phase(film: FilmSample, width: int) -> mi.Float:
    """Return the phase in [0, 2) of each pixel's cone, in steps: modulo 1 it is one of 16.

    Parameters
    ----------
    film
        Where the points lie in the picture.
    width
        Number of points.
    """
    pixel = dr.arange(mi.UInt32, width)
    row, column = pixel // film.width % PATTERN_EDGE, pixel % film.width % PATTERN_EDGE
    rank = dr.gather(mi.UInt32, number_table(BLUE_NOISE), PATTERN_EDGE * row + column)
    shift = dr.opaque(mi.Float, film.number * SAMPLE_TURN % 1.0)
    return mi.Float((mi.Float(rank) + 0.5) / len(BLUE_NOISE) + shift)


@dataclass
class _Tracing:
    """What cones are traced in, how, and who counts."""

    volume: VoxelVolume
    config: SpecularConesConfig
    sky: PrefilteredSky | None
    tally: SampleTally | None

    def __call__(self, points: _Points, cone_of: Callable[[_Points], _Cone]) -> mi.Color3f:
        """Radiance along one cone of each point, 0 where it has none."""
        active = cone_of(points).is_traced
        if self.volume.has_derivatives or dr.grad_enabled(points):
            radiance = self._march(points, cone_of(points), active)
            dr.eval(radiance)
            return radiance
        # Few pixels of a picture shine or let light through.
        width = dr.width(points.position)
        dr.eval(points)
        packed = pack_lanes(active, width)
        here = dr.gather(_Points, points, packed.source, packed.active)
        found = self._march(here, cone_of(here), packed.active)
        # Not zeros, which would be written first, for each of a lobe's cones.
        radiance = dr.empty(mi.Color3f, width)
        dr.scatter(radiance, found, packed.source, packed.active)
        dr.eval(radiance)
        return dr.select(active, radiance, 0.0)

    def _march(self, points: _Points, cone: _Cone, active: mi.Bool) -> mi.Color3f:
        """Radiance along cones that start at points; 0 of those that are not active."""
        config = self.config
        number = FIRST_NUMBER + cone.number
        choice = random_choice(points.sample_index, number, config.march.filtering)
        seen = march_cone(
            self.volume.choosing(choice),
            points.position,
            cone.axis,
            2.0 * dr.tan(0.5 * cone.aperture),
            mi.Float(1.0 - (cone.noise - dr.floor(cone.noise))),
            config.march,
            active,
        )
        if self.tally is not None:
            self.tally.add(seen, active)
        radiance = seen.radiance
        if self.sky is not None:
            beyond = self.sky.read(cone.axis, cone.aperture) * as_component(seen.transmittance)
            radiance += dr.select(active, beyond, 0.0)
        return radiance


PHASE_STREAM = 101
"""Hash stream of the cones' phase."""

FIRST_NUMBER, PASSING = 1000, 13
"""What tells the choices of texels of specular cones from those of diffuse ones, and of the cone
straight through from those of the lobe."""
