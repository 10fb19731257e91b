"""Which diffuse cones are traced, as data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from vctgi.maths.cones import ConeSet, ring_cone_set, ring_sizes
from vctgi.maths.peer_cones import PEER_CONE_SETS, peer_cone_set
from vctgi.stages.cone_tracing.march_config import ConeMarchConfig

Rotation = Literal["fixed", "pixel", "frame"]
"""By what angle cones are turned about the normal: none, one for each camera ray, or one for all
of a frame."""


@dataclass(frozen=True, kw_only=True)
class DiffuseConesConfig:
    """Which diffuse cones are traced."""

    cone_count: int = 17
    """Cones a point, 1 .. 64 (or 256, for studies), in rings (`vctgi.maths.cones`)."""
    cone_set: str | None = None
    """Named set of another system in place of them (`vctgi.maths.peer_cones`)."""
    aperture_scale: float = 1.0
    """Factor on the apertures that cover the hemisphere once, > 0."""
    rotation: Rotation = "pixel"
    """By what angle the cones are turned about the normal: "fixed", "pixel" or "frame". A set that
    belongs to the world is never turned."""
    frame: int = 0
    """Number of the frame, which chooses the angle of "frame", >= 0."""
    is_jittered: bool = True
    """Whether each cone takes a random share of its first step, so that no two sample the voxels
    at the same distances."""
    ring_jitter: float = 0.0
    """Share of the way to a random elevation within its ring by which each cone's axis is moved, in
    [0, 1]: at 1 the axes of many samples fill the hemisphere evenly. Sets of other systems have no
    rings."""
    near_field_voxels: float = 0.0
    """Length of the real ray that replaces the beginning of a cone, in voxels, >= 0; 0: none."""
    normal_offset_voxels: float = 0.0
    """How far above the surface the cones start, in voxels, >= 0; with one-sided slots nothing is
    in their way."""
    cone_apertures: tuple[float, ...] | None = None
    """Full apex angle of each cone, radians, in (0, pi), in place of those that cover the
    hemisphere once; `aperture_scale` is a factor on them, too. None: those of the set."""
    cone_weights: tuple[float, ...] | None = None
    """How much each cone counts, > 0; only ratios matter. None: the set's."""
    cone_elevations: tuple[float, ...] | None = None
    """Angle of each cone's axis to the normal, radians, in [0, pi / 2). None: the set's."""
    cone_azimuths: tuple[float, ...] | None = None
    """Angle of each cone's axis around the normal, radians, before `rotation` turns them all.
    None: the set's."""
    gain: float = 1.0
    """Factor on what they gather, > 0: the scale of another system, 1 for ours."""
    march: ConeMarchConfig = field(default_factory=ConeMarchConfig)
    """How the cones march."""

    def __post_init__(self) -> None:
        """Refuse sets that do not exist."""
        ring_sizes(self.cone_count)
        if self.cone_set is not None and self.cone_set not in PEER_CONE_SETS:
            raise ValueError(
                f"DiffuseConesConfig.cone_set must be None or one of {', '.join(PEER_CONE_SETS)}, "
                f"got {self.cone_set!r}."
            )
        if self.cone_set is not None and self.cones().cone_count != self.cone_count:
            raise ValueError(
                f"DiffuseConesConfig: '{self.cone_set}' has {self.cones().cone_count} cones, but "
                f"cone_count is {self.cone_count}; give the same count, or no cone_set."
            )
        if self.rotation not in get_args(Rotation):
            raise ValueError(
                f"DiffuseConesConfig.rotation must be one of {get_args(Rotation)}, "
                f"got {self.rotation!r}."
            )
        for name in ("frame", "normal_offset_voxels"):
            if getattr(self, name) < 0:
                raise ValueError(
                    f"DiffuseConesConfig.{name} must be >= 0, got {getattr(self, name)}."
                )
        if not self.gain > 0.0:
            raise ValueError(f"DiffuseConesConfig.gain must be > 0, got {self.gain}.")
        if not self.aperture_scale > 0.0:
            raise ValueError(
                f"DiffuseConesConfig.aperture_scale must be > 0, got {self.aperture_scale}."
            )
        if self.near_field_voxels < 0.0:
            raise ValueError(
                f"DiffuseConesConfig.near_field_voxels must be >= 0, got {self.near_field_voxels}."
            )

        self._check_cones()
        widest = max(self.cones().apertures)
        if not widest < math.pi:
            raise ValueError(
                f"DiffuseConesConfig.aperture_scale {self.aperture_scale:g} gives a cone an "
                f"aperture of {math.degrees(widest):.0f} degrees: lower it, they must stay "
                "below 180."
            )

    def _check_cones(self) -> None:
        if not 0.0 <= self.ring_jitter <= 1.0:
            raise ValueError(
                f"DiffuseConesConfig.ring_jitter must be in [0, 1], got {self.ring_jitter}."
            )
        if self.ring_jitter > 0.0 and self.cone_set is not None:
            raise ValueError(
                f"DiffuseConesConfig.ring_jitter: the cones of '{self.cone_set}' stand in no "
                "rings; leave it 0."
            )
        for name, least, limit, includes_least in CONE_LIMITS:
            values = getattr(self, name)
            if values is None:
                continue
            if self.cones_of_set().frame == "world":
                raise ValueError(
                    f"DiffuseConesConfig.{name}: the cones of '{self.cone_set}' belong to the "
                    "world, and only those of a surface can be set; leave it None."
                )
            is_good = all(least < v < limit or (includes_least and v == least) for v in values)
            if len(values) != self.cone_count or not is_good:
                raise ValueError(
                    f"DiffuseConesConfig.{name} must be {self.cone_count} numbers in "
                    f"{'[' if includes_least else '('}{least:g}, {limit:g}), got {values}."
                )

    def cones_of_set(self) -> ConeSet:
        """Return the set as it is named, whatever is put in its place cone by cone."""
        if self.cone_set is not None:
            return peer_cone_set(self.cone_set, self.aperture_scale)
        return ring_cone_set(self.cone_count, self.aperture_scale)

    def cones(self) -> ConeSet:
        """Return the set that is traced."""
        cones = self.cones_of_set()
        if self.cone_apertures is not None:
            apertures = tuple(self.aperture_scale * a for a in self.cone_apertures)
            cones = replace(cones, apertures=apertures)
        if self.cone_weights is not None:
            total = math.fsum(self.cone_weights)
            cones = replace(cones, weights=tuple(w / total for w in self.cone_weights))
        if self.cone_elevations is None and self.cone_azimuths is None:
            return cones
        elevations = self.cone_elevations or [
            math.acos(min(1.0, z)) for _, _, z in cones.directions
        ]
        azimuths = self.cone_azimuths or [math.atan2(y, x) for x, y, _ in cones.directions]
        directions = tuple(map(_axis, elevations, azimuths))
        return replace(cones, directions=directions)


CONE_LIMITS = (
    ("cone_apertures", 0.0, math.pi, False),
    ("cone_weights", 0.0, math.inf, False),
    ("cone_elevations", 0.0, 0.5 * math.pi, True),
    ("cone_azimuths", -math.inf, math.inf, False),
)
"""What can be set cone by cone: name, lower and upper limit, and whether the lower is allowed."""


def _axis(elevation: float, azimuth: float) -> tuple[float, float, float]:
    """Return the unit axis at an angle to +z and one around it."""
    sine = math.sin(elevation)
    return (sine * math.cos(azimuth), sine * math.sin(azimuth), math.cos(elevation))
