"""Which specular cones are traced, as data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from vctgi.stages.cone_tracing.march_config import ConeMarchConfig

PhaseNoise = Literal["none", "random", "blue"]
"""What decides the share of its first step that a cone takes: nothing, a hash, the pixel."""

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
