"""One step of a cone: where it reads, which levels, what the step stops and what it adds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import WINDOW_MARGIN_VOXELS, ClipmapLayout
from vctgi.clipmap.sampling import Medium, VoxelSample, read_medium, read_sample
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.powers import ceil_log2, power_of_two
from vctgi.stages.cone_tracing.live_march import AnyMarch, LiveMarch
from vctgi.stages.cone_tracing.step_rules import corrected_sample, seen_in_medium, step_length

LEVEL_BLEND = 0.15
"""Outer share of a window's half extent over which it fades into the next coarser level."""

PARALLEL = 1e-12
"""Direction components below this count as parallel to a face of the window."""


SMALLEST_FOOTPRINT = 1e-12
"""Footprint in finest voxels below which a cone is a ray in derivatives."""


Read = TypeVar("Read", Medium, VoxelSample)


@dataclass
class ConeRay:
    """A cone as its steps see it.

    Attributes
    ----------
    apex, axis
        Where it starts, and its unit direction.
    ratio
        Footprint diameter over distance.
    t_end
        Where it ends, world units.
    """

    apex: mi.Point3f
    axis: mi.Vector3f
    ratio: mi.Float
    t_end: mi.Float


def next_step(
    volume: VoxelVolume, cone: ConeRay, t: mi.Float, step_share: mi.Float, config: AnyMarch
) -> mi.Float:
    """Return the length of the step that begins at a distance, world units.

    The footprint sets it, the voxels that exist there bound it from below, and it ends with the
    cone. Of the first step only a share is taken.
    """
    p_begin = mi.Point3f(dr.fma(cone.axis, t, cone.apex))
    held = volume.layout.finest_voxel_size * dr.exp2(finest_level(volume, p_begin))
    step = step_length(t, held, cone.ratio, config)
    return dr.minimum(step * step_share, cone.t_end - t)


def read_step(
    volume: VoxelVolume, cone: ConeRay, t: mi.Float, step: mi.Float, config: AnyMarch
) -> tuple[mi.Float, mi.Color3f]:
    """Return the share that the step from a distance stops, and the radiance that it adds."""
    # Voxels at one place of the step, of the levels that enclose the footprint there.
    t_read = dr.fma(config.sample_place, step, t)
    p_read = mi.Point3f(dr.fma(cone.axis, t_read, cone.apex))
    stopped, seen = step_at(volume, p_read, cone.axis, cone.ratio * t_read, step, config)
    if config.falloff_length is not None:
        seen = mi.Color3f(stopped * dr.exp(t_read * (-1.0 / config.falloff_length)))
    return stopped, seen


def advanced(t: mi.Float, step: mi.Float) -> mi.Float:
    """Return the distance behind a step, which is farther even where the step is too short."""
    next_float: float = 1.0 + dr.epsilon(mi.Float)  # type: ignore[no-untyped-call]
    return dr.maximum(t + step, t * next_float)


def step_at(
    volume: VoxelVolume,
    p_world: mi.Point3f,
    axis: mi.Vector3f,
    footprint: mi.Float,
    step: mi.Float,
    config: AnyMarch,
) -> tuple[mi.Float, mi.Color3f]:
    """Return the share that a step stops and the radiance that it adds, of two levels or one.

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
    level = level_read(volume, p_world, footprint, config)

    if config.correction == "depth":

        def medium(each: mi.UInt32) -> Medium:
            rules = (config.read, config.weights, config.pull_back_voxels)
            return read_medium(volume, each, p_world, axis, *rules)

        found = _of_levels(medium, volume, level)
        if isinstance(config, LiveMarch) or config.correction_factor != 1.0:
            step = step * config.correction_factor
        return seen_in_medium(found.extinction, found.source, step)

    def sample(each: mi.UInt32) -> VoxelSample:
        rules = (config.weights, config.pull_back_voxels)
        return read_sample(volume, each, p_world, axis, *rules)

    read = _of_levels(sample, volume, level)
    voxels = step / (layout.finest_voxel_size * dr.exp2(level))
    return corrected_sample(read.opacity, read.emittance, voxels * config.correction_factor, config)


def _of_levels(read: Callable[[mi.UInt32], Read], volume: VoxelVolume, level: mi.Float) -> Read:
    """Read at a fractional level: the two around it in proportion, or one that is chosen.

    The derivative of what is chosen by the level is that of its mean: the difference of the two.
    """
    last, choice = volume.layout.last_read_level, volume.choice
    finer = dr.minimum(mi.UInt32(level), max(last - 1, 0))
    coarser = dr.minimum(finer + 1, last)
    if choice is None:
        blend = level - mi.Float(finer)
        return _part_by_part(
            lambda near, far: dr.lerp(near, far, blend), read(finer), read(coarser)
        )
    found = read(dr.minimum(mi.UInt32(level + choice.level), last))
    if not dr.grad_enabled(level):
        return found
    with dr.suspend_grad():  # type: ignore[no-untyped-call]
        near, far = read(finer), read(coarser)
    moved = level - dr.detach(level)
    return _part_by_part(lambda own, near, far: own + moved * (far - near), found, near, far)


def _part_by_part(combine: Callable[..., Any], *reads: Read) -> Read:
    """Return what is made of each part of reads."""
    parts = ([getattr(each, part.name) for each in reads] for part in fields(reads[0]))
    return type(reads[0])(*(combine(*values) for values in parts))


def level_read(
    volume: VoxelVolume, p_world: mi.Point3f, footprint: mi.Float, config: AnyMarch
) -> mi.Float:
    """Return the fractional level that a cone of this footprint is read from at a point."""
    layout = volume.layout
    if dr.grad_enabled(footprint):
        # The logarithm of a footprint of 0 has no derivative; no level is as fine as this.
        footprint = dr.maximum(footprint, SMALLEST_FOOTPRINT * layout.finest_voxel_size)
    wanted = dr.log2(footprint / layout.finest_voxel_size) + config.level_bias
    last = float(layout.last_read_level)
    return mi.Float(dr.clip(dr.maximum(wanted, finest_level(volume, p_world)), 0.0, last))


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


def finest_level(volume: VoxelVolume, p_world: mi.Point3f) -> mi.Float:
    """Return the finest level that holds a point, fractional where its window fades out.

    Parameters
    ----------
    volume
        The clipmap, of which only the windows are read.
    p_world
        World points, inside the coarsest window or not.

    Returns
    -------
    mi.Float
        Level in [0, read_clip_level_count - 1].
    """
    return level_around(volume.layout, volume.table.centre, p_world)


def level_around(layout: ClipmapLayout, centre: mi.Point3f, p_world: mi.Point3f) -> mi.Float:
    """Return what `finest_level` does, for windows around a centre."""
    last = layout.read_clip_level_count - 1
    if last == 0:
        return mi.Float(0.0)
    offset = dr.abs(p_world - centre)
    distance = mi.Float(dr.maximum(dr.maximum(offset.x, offset.y), offset.z))
    half_extent = (0.5 * layout.resolution - WINDOW_MARGIN_VOXELS) * layout.finest_voxel_size
    # Smallest level whose window holds the point, then a ramp over the rim of that window.
    windows = distance * (1.0 / half_extent)
    level = dr.clip(ceil_log2(dr.maximum(windows, 0.5)), 0, last)
    share = windows * power_of_two(-level)
    ramp = dr.clip(dr.fma(share, 1.0 / LEVEL_BLEND, 1.0 - 1.0 / LEVEL_BLEND), 0.0, 1.0)
    return dr.minimum(mi.Float(level) + mi.Float(ramp), float(last))


def march_range(
    volume: VoxelVolume, apex: mi.Point3f, axis: mi.Vector3f, cone_ratio: mi.Float
) -> tuple[mi.Float, mi.Float]:
    """Return where a cone enters and leaves the coarsest window, or an end of -1 if it misses it.

    The end lies one footprint behind the rim, so that walls at the rim are not cut.
    """
    # A direction parallel to a face would make 0 * inf = NaN where the apex lies on it.
    inverse = 1.0 / dr.select(dr.abs(axis) < PARALLEL, PARALLEL, axis)
    t0 = mi.Vector3f(volume.table.low - apex) * inverse
    t1 = mi.Vector3f(volume.table.high - apex) * inverse
    lower, upper = dr.minimum(t0, t1), dr.maximum(t0, t1)
    enter, leave = mi.Float(dr.max(lower)), mi.Float(dr.min(upper))
    is_hit = (leave > enter) & (leave > 0.0)
    return dr.maximum(enter, 0.0), dr.select(is_hit, leave * (1.0 + cone_ratio), -1.0)
