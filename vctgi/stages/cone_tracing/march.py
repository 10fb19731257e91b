"""The march of a cone through the clipmap, shared by every kind of cone.

A cone accumulates radiance and loses transmittance in steps that grow with its footprint, each
read from a coarser level than the one before. The march is continuous in its parameters: samples
lie in the middle of their step, the last step ends exactly at the rim, levels are interpolated, and
the phase of the first step can be jittered.

Near opacity 1 it stays bounded: the optical depth of a voxel is at most OPTICAL_DEPTH_CAP of
`clipmap/sampling.py`, so neither depth nor derivative becomes infinite. Recipes of other systems
(`vctgi/peers.py`) are rules of the same loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import WINDOW_MARGIN_VOXELS, ClipmapLayout
from vctgi.clipmap.sampling import read_medium, read_sample
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.cone_tracing.live_march import AnyMarch, LiveMarch
from vctgi.stages.cone_tracing.march_config import ConeMarchConfig as ConeMarchConfig
from vctgi.stages.cone_tracing.step_rules import corrected_sample, seen_in_medium, step_length

LEVEL_BLEND = 0.15
"""Outer share of a window's half extent over which it fades into the next coarser level."""

PARALLEL = 1e-12
"""Direction components below this count as parallel to a face of the window."""


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
    config: AnyMarch,
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
    t_begin, t_end = march_range(layout, apex, axis, cone_ratio)
    t_end = limited_end(layout, t_end, cone_ratio, config)
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
        step = step_length(t, held, cone_ratio, config)
        step = dr.minimum(step * step_share, t_end - t)

        # Voxels at one place of the step, between the two levels that enclose the footprint there.
        t_read = dr.fma(config.sample_place, step, t)
        p_read = mi.Point3f(dr.fma(axis, t_read, apex))
        stopped, seen = step_at(volume, p_read, axis, cone_ratio * t_read, step, config)
        if config.falloff_length is not None:
            seen = mi.Color3f(stopped * dr.exp(t_read * (-1.0 / config.falloff_length)))
        radiance = dr.fma(as_component(transmittance), seen, radiance)
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


def step_at(
    volume: VoxelVolume,
    p_world: mi.Point3f,
    axis: mi.Vector3f,
    footprint: mi.Float,
    step: mi.Float,
    config: AnyMarch,
) -> tuple[mi.Float, mi.Color3f]:
    """Return the share that a step stops and the radiance that it adds, between two levels.

    Parameters
    ----------
    volume, axis, config
        As for `march_cone`.
    p_world
        Where the voxels are read.
    footprint
        Diameter of the cone there, world units.
    step
        Length of the step, world units.
    """
    layout = volume.layout
    last = len(layout.levels) - 1
    level = level_read(layout, p_world, footprint, config)
    finer = dr.minimum(mi.UInt32(level), max(last - 1, 0))
    coarser = dr.minimum(finer + 1, last)
    blend = level - mi.Float(finer)
    places = [(each, p_world - _pull_back(layout, each, axis, config)) for each in (finer, coarser)]

    if config.correction == "depth":
        near, far = (
            read_medium(volume, each, place, axis, config.read, config.weights)
            for each, place in places
        )
        extinction = dr.lerp(near.extinction, far.extinction, blend)
        source = dr.lerp(near.source, far.source, as_component(blend))
        if isinstance(config, LiveMarch) or config.correction_factor != 1.0:
            step = step * config.correction_factor
        return seen_in_medium(extinction, source, step)
    fine, coarse = (
        read_sample(volume, each, place, axis, config.weights) for each, place in places
    )
    opacity = dr.lerp(fine.opacity, coarse.opacity, blend)
    emitted = dr.lerp(fine.emittance, coarse.emittance, as_component(blend))
    voxels = step / (layout.finest_voxel_size * dr.exp2(level))
    return corrected_sample(opacity, emitted, voxels * config.correction_factor, config)


def level_read(
    layout: ClipmapLayout, p_world: mi.Point3f, footprint: mi.Float, config: AnyMarch
) -> mi.Float:
    """Return the fractional level that a cone of this footprint is read from at a point."""
    wanted = dr.log2(footprint / layout.finest_voxel_size) + config.level_bias
    last = float(len(layout.levels) - 1)
    return mi.Float(dr.clip(dr.maximum(wanted, finest_level(layout, p_world)), 0.0, last))


def limited_end(
    layout: ClipmapLayout, t_end: mi.Float, cone_ratio: mi.Float, config: AnyMarch
) -> mi.Float:
    """Return where cones end that have a limit of their own."""
    if config.max_distance_voxels is not None:
        t_end = dr.minimum(t_end, config.max_distance_voxels * layout.finest_voxel_size)
    if config.max_footprint_voxels is not None:
        widest = config.max_footprint_voxels * layout.finest_voxel_size
        t_end = dr.minimum(t_end, widest / dr.maximum(cone_ratio, PARALLEL))
    return t_end


def _pull_back(
    layout: ClipmapLayout, level: mi.UInt32, axis: mi.Vector3f, config: AnyMarch
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


def march_range(
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
