"""Specular cones: one along each visible point's mean glossy lobe, one straight through it.

Every pixel traces its own. All cones of a picture that start alike sample the voxels at the same
distances, which shows as bands where steps are long; so each takes another share of its first step.
The shares are random, or the 16 of a 4x4 pattern bound to the pixels, whose mean over any 4x4
pixels holds each share once (`vctgi.stages.reconstruction.denoising` takes it).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone

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

    Raises
    ------
    ValueError
        Blue noise for points that have no place in a picture.
    """
    phase = _first_step_share(gbuffer, config, film)
    nothing = dr.zeros(mi.Color3f, dr.width(gbuffer.position))
    reflected = passed = nothing
    if has_specular:
        # A lobe that is wider than a cone can be ends at WIDEST_CONE.
        aperture = dr.clip(gbuffer.specular_aperture, config.min_aperture, WIDEST_CONE)
        lobe = gbuffer.specular_axis, aperture, gbuffer.specular_albedo
        reflected = _trace(gbuffer, volume, lobe, phase, config.march, sky)
    if has_passing:
        narrow = mi.Float(config.min_aperture)
        lobe = gbuffer.ray_direction, narrow, gbuffer.passed
        passed = _trace(gbuffer, volume, lobe, phase, config.march, sky)
    return SpecularLight(reflected, passed)


def _first_step_share(
    gbuffer: GBuffer, config: SpecularConesConfig, film: FilmSample | None
) -> mi.Float:
    """Share of the first step that each point's cones take, (0, 1]."""
    noise = dr.opaque(mi.Float, config.phase_offset)
    if config.noise == "random":
        noise = noise + random_unit(gbuffer.sample_index, PHASE_STREAM)
    elif config.noise == "blue":
        if film is None:
            raise ValueError(
                'trace_specular: noise "blue" is bound to pixels, and these points have none: '
                'pass `film`, or set SpecularConesConfig.noise to "random".'
            )
        noise = noise + blue_noise_phase(film, dr.width(gbuffer.position))
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
    rank = dr.gather(mi.UInt32, mi.UInt32(list(BLUE_NOISE)), PATTERN_EDGE * row + column)
    shift = dr.opaque(mi.Float, film.number * SAMPLE_TURN % 1.0)
    return mi.Float((mi.Float(rank) + 0.5) / len(BLUE_NOISE) + shift)


def _trace(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    lobe: tuple[mi.Vector3f, mi.Float, mi.Color3f],
    phase: mi.Float,
    march: ConeMarchConfig,
    sky: PrefilteredSky | None,
) -> mi.Color3f:
    """Radiance along one cone of each point (axis, aperture, weight) whose weight is not zero."""
    axis, aperture, weight = lobe
    active = gbuffer.is_valid & (dr.max(weight) > 0.0)
    ratio = 2.0 * dr.tan(0.5 * aperture)
    cone = march_cone(volume, gbuffer.position, axis, ratio, phase, march, active)
    radiance = cone.radiance
    if sky is not None:
        beyond = sky.read(axis, aperture) * as_component(cone.transmittance)
        radiance += dr.select(active, beyond, 0.0)
    dr.eval(radiance)
    return radiance


PHASE_STREAM = 101
"""Hash stream of the cones' phase."""
