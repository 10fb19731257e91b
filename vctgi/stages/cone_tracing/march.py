"""The march of a cone through the clipmap, shared by every kind of cone.

A cone accumulates radiance and loses transmittance in steps that grow with its footprint, each
read from a coarser level than the one before. The march is continuous in its parameters: samples
lie in the middle of their step, the last step ends exactly at the rim, levels are interpolated, and
the phase of the first step can be jittered.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import WINDOW_MARGIN_VOXELS, ClipmapLayout
from vctgi.clipmap.sampling import read_medium
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.stub_gaps import as_component

LEVEL_BLEND = 0.15
"""Outer share of a window's half extent over which it fades into the next coarser level."""

PARALLEL = 1e-12
"""Direction components below this count as parallel to a face of the window."""


@dataclass(frozen=True, kw_only=True)
class ConeMarchConfig:
    """How a cone marches."""

    step_ratio: float = 0.5
    """Step length over footprint, (0, 1]."""
    min_step_voxels: float = 0.25
    """Shortest step, in voxels of the finest level that holds the sample, > 0."""
    start_offset_voxels: float = 1.0
    """Distance of the first sample from the apex, in voxels, >= 0."""
    level_bias: float = -1.0
    """Added to log2(footprint / finest voxel size)."""
    pull_back_voxels: float = 0.25
    """How far before the sample the voxels are read, because a ray meets a smeared wall early."""
    min_transmittance: float = 1e-4
    """A cone that lets less through has ended, [0, 1)."""
    falloff_length: float | None = None
    """If given, a voxel at distance t sends out exp(-t / falloff_length) in place of its light, so
    that a cone gathers how far what is near closes it off; world units, > 0, may be infinite."""

    def __post_init__(self) -> None:
        """Refuse a march that skips voxels or never ends."""
        if not 0.0 < self.step_ratio <= 1.0:
            raise ValueError(
                f"ConeMarchConfig.step_ratio must be in (0, 1], got {self.step_ratio}: "
                "a larger step skips voxels."
            )
        if not self.min_step_voxels > 0.0:
            raise ValueError(
                f"ConeMarchConfig.min_step_voxels must be > 0, got {self.min_step_voxels}: "
                "a thin cone would never end."
            )
        if self.start_offset_voxels < 0.0:
            raise ValueError(
                f"ConeMarchConfig.start_offset_voxels must be >= 0, got {self.start_offset_voxels}."
            )
        if not 0.0 <= self.min_transmittance < 1.0:
            raise ValueError(
                "ConeMarchConfig.min_transmittance must be in [0, 1), "
                f"got {self.min_transmittance}."
            )
        if self.falloff_length is not None and not self.falloff_length > 0.0:
            raise ValueError(
                f"ConeMarchConfig.falloff_length must be > 0, got {self.falloff_length}."
            )


@dataclass
class ConeSample:
    """What a cone gathered.

    Attributes
    ----------
    radiance
        Mean radiance over the cone, W m^-2 sr^-1.
    transmittance
        Share of the cone that nothing stopped, [0, 1].
    step_count
        Steps taken.
    """

    radiance: mi.Color3f
    transmittance: mi.Float
    step_count: mi.UInt32


def march_cone(
    volume: VoxelVolume,
    apex: mi.Point3f,
    axis: mi.Vector3f,
    cone_ratio: mi.Float,
    phase: mi.Float,
    config: ConeMarchConfig,
    active: mi.Bool,
    t_near: mi.Float | float = 0.0,
) -> ConeSample:
    """March one cone per lane through the clipmap.

    Parameters
    ----------
    volume
        Opacity and emittance to march through.
    apex
        World points where the cones start.
    axis
        Unit directions.
    cone_ratio
        Footprint diameter over distance, 2 tan(aperture / 2), >= 0.
    phase
        Share of the first step that is taken, (0, 1].
    config
        Step, offset and level rules.
    active
        Lanes that march; the others return nothing seen and everything let through.
    t_near
        Distance before which the cone is not marched, because real rays saw to it, world units.

    References
    ----------
    [Panteleev2014], slides "Cone tracing basics" and "Diffuse and specular cone tracing".
    """
    layout = volume.layout
    # Every loop variable starts at its full width: a one-lane start returns wrong derivatives.
    width = max(dr.width(apex), dr.width(axis))
    full = dr.zeros(mi.Float, width)
    t_begin, t_end = _march_range(layout, apex, axis, cone_ratio)
    start = config.start_offset_voxels * layout.finest_voxel_size
    next_float: float = 1.0 + dr.epsilon(mi.Float)  # type: ignore[no-untyped-call]
    t_start = dr.maximum(start * dr.exp2(finest_level(layout, apex)), t_near)
    t = dr.maximum(t_begin, t_start) + full

    def is_running(
        t: mi.Float,
        step_share: mi.Float,
        transmittance: mi.Float,
        radiance: mi.Color3f,
        step_count: mi.UInt32,
    ) -> mi.Bool:
        return active & (t < t_end) & (transmittance > config.min_transmittance)

    def advance(
        t: mi.Float,
        step_share: mi.Float,
        transmittance: mi.Float,
        radiance: mi.Color3f,
        step_count: mi.UInt32,
    ) -> tuple[mi.Float, mi.Float, mi.Float, mi.Color3f, mi.UInt32]:
        # Step length: the footprint sets it, and the voxels that exist here bound it from below.
        p_begin = mi.Point3f(dr.fma(axis, t, apex))
        held = layout.finest_voxel_size * dr.exp2(finest_level(layout, p_begin))
        step = dr.maximum(config.step_ratio * cone_ratio * t, config.min_step_voxels * held)
        step = dr.minimum(step * step_share, t_end - t)

        # Medium in the middle of the step, between the two levels that enclose the footprint.
        t_middle = dr.fma(0.5, step, t)
        p_middle = mi.Point3f(dr.fma(axis, t_middle, apex))
        extinction, source = _read_at(volume, p_middle, axis, cone_ratio * t_middle, config)
        if config.falloff_length is not None:
            source = mi.Color3f(extinction * dr.exp(t_middle * (-1.0 / config.falloff_length)))

        # Emission and absorption over the step, in closed form for a homogeneous medium.
        stopped = 1.0 - dr.exp(-extinction * step)
        is_clear = extinction <= 0.0
        seen = source * as_component(stopped / dr.select(is_clear, 1.0, extinction))
        radiance = dr.fma(as_component(transmittance), dr.select(is_clear, 0.0, seen), radiance)
        # The step may be too short to change t in single precision far from the apex.
        t = dr.maximum(t + step, t * next_float)
        return t, full + 1.0, transmittance * (1.0 - stopped), radiance, step_count + 1

    _, _, transmittance, radiance, step_count = dr.while_loop(
        state=(
            t,
            phase + full,
            full + 1.0,
            mi.Color3f(full, full, full),
            dr.zeros(mi.UInt32, width),
        ),
        cond=is_running,
        body=advance,
        labels=("t", "step_share", "transmittance", "radiance", "step_count"),
        label="march_cone",
    )
    return ConeSample(radiance, transmittance, step_count)


def _read_at(
    volume: VoxelVolume,
    p_world: mi.Point3f,
    axis: mi.Vector3f,
    footprint: mi.Float,
    config: ConeMarchConfig,
) -> tuple[mi.Float, mi.Color3f]:
    """Extinction and source per world unit at a footprint, interpolated between two levels."""
    layout = volume.layout
    last = len(layout.levels) - 1
    wanted = dr.log2(footprint / layout.finest_voxel_size) + config.level_bias
    level = mi.Float(dr.clip(dr.maximum(wanted, finest_level(layout, p_world)), 0.0, float(last)))
    finer = dr.minimum(mi.UInt32(level), max(last - 1, 0))
    coarser = dr.minimum(finer + 1, last)
    blend = level - mi.Float(finer)

    near, far = (
        read_medium(volume, each, p_world - _pull_back(layout, each, axis, config), axis)
        for each in (finer, coarser)
    )
    return (
        dr.lerp(near.extinction, far.extinction, blend),
        dr.lerp(near.source, far.source, as_component(blend)),
    )


def _pull_back(
    layout: ClipmapLayout, level: mi.UInt32, axis: mi.Vector3f, config: ConeMarchConfig
) -> mi.Point3f:
    """Return by how much a level is read before the sample, world units."""
    distance = config.pull_back_voxels * layout.finest_voxel_size * dr.exp2(mi.Float(level))
    return mi.Point3f(axis * as_component(distance))


def finest_level(layout: ClipmapLayout, p_world: mi.Point3f) -> mi.Float:
    """Return the finest level that holds a point, fractional where its window fades out.

    Parameters
    ----------
    layout
        The clipmap.
    p_world
        World points, inside the coarsest window or not.

    Returns
    -------
    mi.Float
        Level in [0, clip_level_count - 1].
    """
    last = layout.clip_level_count - 1
    if last == 0:
        return mi.Float(0.0)
    offset = dr.abs(p_world - mi.Point3f(*layout.centre))
    distance = mi.Float(dr.maximum(dr.maximum(offset.x, offset.y), offset.z))
    half_extent = (0.5 * layout.resolution - WINDOW_MARGIN_VOXELS) * layout.finest_voxel_size
    # Smallest level whose window holds the point, then a ramp over the rim of that window.
    windows = dr.maximum(distance / half_extent, 0.5)
    level = dr.maximum(dr.ceil(dr.log2(windows)), 0.0)
    share = distance / (half_extent * dr.exp2(level))
    ramp = dr.clip((share - (1.0 - LEVEL_BLEND)) / LEVEL_BLEND, 0.0, 1.0)
    return dr.minimum(level + ramp, float(last))


def _march_range(
    layout: ClipmapLayout, apex: mi.Point3f, axis: mi.Vector3f, cone_ratio: mi.Float
) -> tuple[mi.Float, mi.Float]:
    """Return where a cone enters and leaves the coarsest window, or an end of -1 if it misses it.

    The end lies one footprint behind the rim, so that walls at the rim are not cut.
    """
    box = layout.coarsest
    # A direction parallel to a face would make 0 * inf = NaN where the apex lies on it.
    inverse = 1.0 / dr.select(dr.abs(axis) < PARALLEL, PARALLEL, axis)
    t0 = mi.Vector3f(mi.Point3f(*box.window_min) - apex) * inverse
    t1 = mi.Vector3f(mi.Point3f(*box.window_max) - apex) * inverse
    lower, upper = dr.minimum(t0, t1), dr.maximum(t0, t1)
    enter, leave = mi.Float(dr.max(lower)), mi.Float(dr.min(upper))
    is_hit = (leave > enter) & (leave > 0.0)
    return dr.maximum(enter, 0.0), dr.select(is_hit, leave * (1.0 + cone_ratio), -1.0)
