"""Ambient occlusion: how open the hemisphere over each visible point is, by cones.

A point is as open as the share of an even surrounding light that reaches it. A surface at distance
t closes off its part of the hemisphere by exp(-t / range): wholly where it touches, less the
farther away it is, so that a closed room of any size is not black. With an infinite range the
answer is plain visibility. Only opacity is read: no light is needed, and none is computed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.clipmap.texel_choice import random_choice
from vctgi.maths.cones import ratio_from_aperture, ring_cone_set, ring_sizes
from vctgi.maths.constant_tables import float_table
from vctgi.maths.directions import random_unit
from vctgi.scene.extent import longest_edge
from vctgi.scene.records import GBuffer
from vctgi.stages.cone_tracing.lane_order import LaneOrder
from vctgi.stages.cone_tracing.live_march import AnyMarch, LiveMarch
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone
from vctgi.stages.cone_tracing.near_field import trace_near_field
from vctgi.stages.cone_tracing.passes import trace_in_passes
from vctgi.stages.cone_tracing.tally import SampleTally


@dataclass(frozen=True, kw_only=True)
class AmbientConfig:
    """How ambient occlusion is traced."""

    cone_count: int = 9
    """Cones a point, 1 .. 64, in rings (`vctgi.maths.cones`)."""
    range_world: float | None = None
    """Distance at which a surface closes off 1/e of what it covers, world units, > 0."""
    range_share: float | None = 0.1
    """The same as a share of the longest edge of the scene's bounds, > 0; give one of both, or
    neither for an infinite range."""
    is_rotated: bool = True
    """Whether each pixel turns its cones about the normal by an angle of its own."""
    is_jittered: bool = True
    """Whether each cone takes a random share of its first step."""
    near_field_voxels: float = 2.0
    """Length of the real ray that replaces the beginning of a cone, in voxels, >= 0; 0: none, and
    what is nearer than the march's start closes off nothing."""
    march: ConeMarchConfig = field(default_factory=ConeMarchConfig)
    """How the cones march; their falloff is set from the range."""

    def __post_init__(self) -> None:
        """Refuse sets that do not exist, and ranges that mean nothing."""
        ring_sizes(self.cone_count)
        if self.range_world is not None and self.range_share is not None:
            raise ValueError(
                "AmbientConfig.range_world and range_share are two ways to say one thing: "
                "set one of them to None."
            )
        if self.near_field_voxels < 0.0:
            raise ValueError(
                f"AmbientConfig.near_field_voxels must be >= 0, got {self.near_field_voxels}."
            )
        for name in ("range_world", "range_share"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ValueError(
                    f"AmbientConfig.{name} must be > 0, got {value}; None stands for no limit."
                )

    def range_in(self, scene_extent: float) -> float:
        """Return the range in a scene whose longest edge is given, world units."""
        if self.range_share is not None:
            return self.range_share * scene_extent
        return math.inf if self.range_world is None else self.range_world


def trace_ambient(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: AmbientConfig,
    scene: mi.Scene,
    tally: SampleTally | None = None,
    range_scale: mi.Float | None = None,
) -> mi.Float:
    """Return how open the hemisphere over each visible point is.

    Parameters
    ----------
    gbuffer
        Visible points.
    volume
        Voxels, of which only the opacity is read.
    config
        Cones and range.
    scene
        Geometry, whose extent the range may be a share of, and which the near field traces.
    tally
        Counts what the cones read; None: nothing is counted.
    range_scale
        Factor on the range, one lane, for derivatives; None: 1.

    Returns
    -------
    mi.Float
        Share of an even surrounding radiance that arrives, cosine-weighted, [0, 1]; 1 where the
        ray met no surface.

    References
    ----------
    [Panteleev2014], slide "Performance"; the exponential falloff is that of obscurance
    [Zhukov1998].
    """
    length = config.range_in(longest_edge(scene))
    march: AnyMarch = replace(config.march, falloff_length=length)
    reach: float | mi.Float = length
    if range_scale is not None:
        reach = mi.Float(length * range_scale)
        march = LiveMarch.of_numbers(config.march, reach)

    def trace(part: GBuffer) -> mi.Float:
        return _trace_pass(part, volume, config, scene, tally, (march, reach))

    return trace_in_passes(gbuffer, config.cone_count, trace)


def _trace_pass(
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: AmbientConfig,
    scene: mi.Scene,
    tally: SampleTally | None,
    falloff: tuple[AnyMarch, float | mi.Float],
) -> mi.Float:
    """Return how open the hemisphere is over as many points as fit one pass."""
    cones = ring_cone_set(config.cone_count)
    march, reach = falloff
    points = dr.width(gbuffer.position)
    order = LaneOrder.of(cones.cone_count, config.near_field_voxels)
    lanes = order.deal(points)
    point, number = lanes.point, lanes.cone
    apex = dr.gather(mi.Point3f, gbuffer.position, point)
    normal = dr.gather(mi.Vector3f, gbuffer.normal, point)
    sample_index = dr.gather(mi.UInt32, gbuffer.sample_index, point)
    active = lanes.is_used & dr.gather(mi.Bool, gbuffer.is_valid, point)

    turn = 2.0 * math.pi * random_unit(sample_index, ROTATION_STREAM)
    sin, cos = dr.sincos(turn if config.is_rotated else mi.Float(0.0))
    x, y, z = (
        dr.gather(mi.Float, float_table(tuple(d[axis] for d in cones.directions)), number)
        for axis in range(3)
    )
    local = mi.Vector3f(cos * x - sin * y, sin * x + cos * y, z)
    axis = mi.Vector3f(mi.Frame3f(normal).to_world(local))
    ratios = float_table(tuple(ratio_from_aperture(each) for each in cones.apertures))
    jitter = random_unit(sample_index, PHASE_STREAM + number) if config.is_jittered else 0.0
    hidden, begin = mi.Float(0.0), mi.Float(0.0)
    if config.near_field_voxels > 0.0:
        voxels = config.near_field_voxels
        near = trace_near_field(scene, volume, apex, normal, axis, voxels, active)
        if tally is not None:
            tally.add_rays(active, dr.width(point))
        hidden = dr.select(near.is_hit, dr.exp(near.distance * (-1.0 / reach)), 0.0)
        active, begin = active & ~near.is_hit, near.reach
    ratio, phase = dr.gather(mi.Float, ratios, number), mi.Float(1.0 - jitter)
    chosen = volume.choosing(random_choice(sample_index, number, march.filtering))
    cone = march_cone(chosen, apex, axis, ratio, phase, march, active, begin)
    if tally is not None:
        tally.add(cone, active)
    stopped = mi.Float(mi.Float(cone.radiance.x) + hidden)
    dr.eval(stopped)

    closed = mi.Float(0.0)
    place = dr.arange(mi.UInt32, points)
    for each, weight in enumerate(cones.weights):
        own = dr.gather(mi.Float, stopped, order.lane_of(place, each))
        closed = dr.fma(weight, own, closed)
    # Weights sum to 1 but for rounding.
    return dr.select(gbuffer.is_valid, 1.0 - dr.minimum(closed, 1.0), 1.0)


ROTATION_STREAM, PHASE_STREAM = 400, 401
"""Hash streams of the cones' rotation and, from the second on, of each cone's phase."""
