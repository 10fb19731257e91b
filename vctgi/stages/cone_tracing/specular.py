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
from dataclasses import dataclass, field
from typing import Literal, get_args

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
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone
from vctgi.stages.cone_tracing.tally import SampleTally

WIDEST_CONE = 0.95 * math.pi
"""Aperture at which a cone becomes a half space and its footprint infinite; wider lobes are traced
as a cone of this one."""


PhaseNoise = Literal["none", "random", "blue"]
"""What decides the share of its first step that a cone takes: nothing, a hash, the pixel."""

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


ROUGH_CONE_COUNTS = range(4, 14)
"""Cones that a rough lobe can be split into."""


def specular_march(step_voxels: float) -> ConeMarchConfig:
    """Return a march by steps of so many voxels of the level that is read; the talk's are 1.0.

    Parameters
    ----------
    step_voxels
        (0, 2]: voxels that are read are half as wide as the cone, where the finest level allows.
    """
    level_bias = -1.0
    return ConeMarchConfig(
        step_ratio=step_voxels * 2.0**level_bias,
        min_step_voxels=step_voxels,
        level_bias=level_bias,
    )


@dataclass(frozen=True, kw_only=True)
class SpecularConesConfig:
    """How specular cones are traced."""

    min_aperture: float = 0.01
    """Full apex angle of the cone of a perfect mirror, radians, > 0."""
    noise: PhaseNoise = "random"
    """Share of its first step that each cone takes: "none" (the whole step), "random", or "blue":
    one of 16 by the place of its pixel."""
    aperture_scale: float = 1.0
    """Factor on the apertures of all lobes, > 0."""
    rough_cone_count: int = 7
    """Cones of a rough lobe: 1 (never split), or one and a ring of 3 to 12 around it."""
    rough_aperture: float = 0.5
    """Full apex angle from which on a lobe is rough, radians, > 0. The cones part gradually, and
    cover their lobe from twice this angle on."""
    phase_offset: float = 0.0
    """Added to that share by all cones alike, modulo 1, in [0, 1); a sweep of it shows banding."""
    march: ConeMarchConfig = field(
        default_factory=lambda: ConeMarchConfig(min_step_voxels=0.5, level_bias=-1.0)
    )
    """How the cones march."""

    def __post_init__(self) -> None:
        """Refuse cones without a footprint."""
        if not self.min_aperture > 0.0:
            raise ValueError(
                f"SpecularConesConfig.min_aperture must be > 0, got {self.min_aperture}."
            )
        if self.rough_cone_count != 1 and self.rough_cone_count not in ROUGH_CONE_COUNTS:
            raise ValueError(
                "SpecularConesConfig.rough_cone_count must be 1 or "
                f"{ROUGH_CONE_COUNTS.start}..{ROUGH_CONE_COUNTS.stop - 1}, "
                f"got {self.rough_cone_count}."
            )
        if not self.aperture_scale > 0.0:
            raise ValueError(
                f"SpecularConesConfig.aperture_scale must be > 0, got {self.aperture_scale}."
            )
        if not self.rough_aperture > 0.0:
            raise ValueError(
                f"SpecularConesConfig.rough_aperture must be > 0, got {self.rough_aperture}."
            )
        if self.noise not in get_args(PhaseNoise):
            raise ValueError(
                f"SpecularConesConfig.noise must be one of {get_args(PhaseNoise)}, "
                f"got {self.noise!r}."
            )
        if not 0.0 <= self.phase_offset < 1.0:
            raise ValueError(
                f"SpecularConesConfig.phase_offset must be in [0, 1), got {self.phase_offset}."
            )


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
    noise = _noise(gbuffer, config, film)
    reflected = passed = dr.zeros(mi.Color3f, dr.width(gbuffer.position))
    if has_specular:
        reflected = _trace_lobe(gbuffer, volume, config, noise, sky, tally)
    if has_passing:
        narrow = _Cone(gbuffer.ray_direction, mi.Float(config.min_aperture), PASSING)
        active = gbuffer.is_valid & (dr.max(gbuffer.passed) > 0.0)
        share = _first_step_share(noise)
        passed = _trace(gbuffer, volume, narrow, share, config, sky, active, tally)
    return SpecularLight(reflected, passed)


@dataclass
class _Cone:
    """Unit axis and full apex angle of one cone a lane, and which of its point's cones it is."""

    axis: mi.Vector3f
    aperture: mi.Float
    number: mi.UInt32 | int


def _trace_lobe(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: SpecularConesConfig,
    noise: mi.Float,
    sky: PrefilteredSky | None,
    tally: SampleTally | None,
) -> mi.Color3f:
    """Mean radiance over each point's lobe."""
    # A lobe that is wider than a cone can be ends at WIDEST_CONE.
    aperture = gbuffer.specular_aperture
    if config.aperture_scale != 1.0:
        aperture = aperture * config.aperture_scale
    aperture = dr.clip(aperture, config.min_aperture, WIDEST_CONE)
    lobe = _Cone(gbuffer.specular_axis, aperture, 0)
    active = gbuffer.is_valid & (dr.max(gbuffer.specular_albedo) > 0.0)
    count = config.rough_cone_count
    if count == 1:
        return _trace(gbuffer, volume, lobe, _first_step_share(noise), config, sky, active, tally)
    is_rough = active & (aperture > config.rough_aperture)
    total = dr.zeros(mi.Color3f, dr.width(gbuffer.position))
    total_weight = dr.zeros(mi.Float, dr.width(gbuffer.position))
    for number in range(count):
        # Opaque, so that all cones share one kernel.
        place = dr.opaque(mi.UInt32, number)
        part = with_boundary(lobe)
        cone = _part_of_lobe(part, place, count, noise, config.rough_aperture)
        is_above = dr.dot(cone.axis, gbuffer.normal) > 0.0
        is_traced = dr.select(place == 0, active, is_rough & is_above)
        share = _first_step_share(noise + SAMPLE_TURN * mi.Float(place))
        seen = _trace(gbuffer, volume, cone, share, config, sky, is_traced, tally)
        total += dr.select(is_traced, seen, 0.0)
        total_weight += dr.select(is_traced, 1.0, mi.Float(0.0))
        dr.eval(total, total_weight)
    return mi.Color3f(total / as_component(dr.maximum(total_weight, 1.0)))


def _part_of_lobe(
    lobe: _Cone, number: mi.UInt32, count: int, noise: mi.Float, rough_aperture: float
) -> _Cone:
    """Return one of the cones that share a lobe evenly: number 0 in the middle, a ring of others.

    Up to `rough_aperture` all of them are the lobe, so that no seam shows where it is crossed.
    """
    parting = dr.clip(lobe.aperture / rough_aperture - 1.0, 0.0, 1.0)
    height = 1.0 - dr.cos(0.5 * lobe.aperture)
    part = 2.0 * dr.acos(1.0 - height / count)
    # The ring holds the shares from 1 / count to 1; half of its light lies within their mean.
    from_axis = parting * dr.acos(1.0 - height * (0.5 + 0.5 / count))
    from_axis = dr.select(number == 0, 0.0, from_axis)
    turn = (mi.Float(number) + noise) / (count - 1)
    axis_sine, axis_cosine = dr.sincos(from_axis)
    sine, cosine = dr.sincos(2.0 * math.pi * turn)
    local = mi.Vector3f(axis_sine * cosine, axis_sine * sine, axis_cosine)
    axis = mi.Vector3f(mi.Frame3f(lobe.axis).to_world(local))
    return _Cone(axis, mi.Float(dr.lerp(lobe.aperture, part, parting)), number)


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


def _first_step_share(noise: mi.Float) -> mi.Float:
    """Share of its first step that a cone takes, (0, 1]."""
    return mi.Float(1.0 - (noise - dr.floor(noise)))


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


def _trace(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    cone: _Cone,
    first_step_share: mi.Float,
    config: SpecularConesConfig,
    sky: PrefilteredSky | None,
    active: mi.Bool,
    tally: SampleTally | None,
) -> mi.Color3f:
    """Radiance along one cone of each active point."""
    ratio = 2.0 * dr.tan(0.5 * cone.aperture)
    number = FIRST_NUMBER + mi.UInt32(cone.number)
    choice = random_choice(gbuffer.sample_index, number, config.march.filtering)
    chosen = volume.choosing(choice)
    seen = march_cone(
        chosen, gbuffer.position, cone.axis, ratio, first_step_share, config.march, active
    )
    if tally is not None:
        tally.add(seen, active)
    radiance = seen.radiance
    if sky is not None:
        beyond = sky.read(cone.axis, cone.aperture) * as_component(seen.transmittance)
        radiance += dr.select(active, beyond, 0.0)
    dr.eval(radiance)
    return radiance


PHASE_STREAM = 101
"""Hash stream of the cones' phase."""

FIRST_NUMBER, PASSING = 1000, 13
"""What tells the choices of texels of specular cones from those of diffuse ones, and of the cone
straight through from those of the lobe."""
