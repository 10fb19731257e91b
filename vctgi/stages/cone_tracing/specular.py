"""Specular cones: one along each visible point's mean glossy lobe, one straight through it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone

WIDEST_CONE = 0.95 * math.pi
"""Aperture at which a cone becomes a half space and its footprint infinite; wider lobes are traced
as a cone of this one."""


@dataclass(frozen=True, kw_only=True)
class SpecularConesConfig:
    """How specular cones are traced."""

    min_aperture: float = 0.01
    """Full apex angle of the cone of a perfect mirror, radians, > 0."""
    is_jittered: bool = True
    """Whether each cone takes a random share of its first step."""
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


def trace_specular(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: SpecularConesConfig,
    *,
    has_specular: bool,
    has_passing: bool,
    sky: PrefilteredSky | None = None,
) -> mi.Color3f:
    """Gather the light that glossy lobes reflect, and that masks and thin glass let through.

    Parameters
    ----------
    gbuffer
        Visible points with their lobes.
    volume
        Lit voxels.
    config
        March and narrowest cone.
    has_specular, has_passing
        Which of the two cones the scene needs.
    sky
        What the share of a cone sees that nothing stops; None: darkness.

    Returns
    -------
    mi.Color3f
        Radiance towards the viewer, W m^-2 sr^-1.
    """
    total = dr.zeros(mi.Color3f, dr.width(gbuffer.position))
    if has_specular:
        # A lobe that is wider than a cone can be ends at WIDEST_CONE.
        aperture = dr.clip(gbuffer.specular_aperture, config.min_aperture, WIDEST_CONE)
        lobe = gbuffer.specular_axis, aperture, gbuffer.specular_albedo
        total += gbuffer.specular_albedo * _trace(gbuffer, volume, lobe, config, sky)
    if has_passing:
        narrow = mi.Float(config.min_aperture)
        lobe = gbuffer.ray_direction, narrow, gbuffer.passed
        total += gbuffer.passed * _trace(gbuffer, volume, lobe, config, sky)
    return total


def _trace(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    lobe: tuple[mi.Vector3f, mi.Float, mi.Color3f],
    config: SpecularConesConfig,
    sky: PrefilteredSky | None,
) -> mi.Color3f:
    """Radiance along one cone of each point (axis, aperture, weight) whose weight is not zero."""
    axis, aperture, weight = lobe
    jitter = random_unit(gbuffer.sample_index, PHASE_STREAM) if config.is_jittered else 0.0
    phase = mi.Float(1.0 - jitter)
    active = gbuffer.is_valid & (dr.max(weight) > 0.0)
    ratio = 2.0 * dr.tan(0.5 * aperture)
    cone = march_cone(volume, gbuffer.position, axis, ratio, phase, config.march, active)
    radiance = cone.radiance
    if sky is not None:
        beyond = sky.read(axis, aperture) * as_component(cone.transmittance)
        radiance += dr.select(active, beyond, 0.0)
    dr.eval(radiance)
    return radiance


PHASE_STREAM = 101
"""Hash stream of the cones' phase."""
