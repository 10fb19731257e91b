"""The march of one cone, as a plain loop in double precision."""

from __future__ import annotations

import math

import numpy as np

from tests.vctgi.twins.reading import HostVolume, read_medium
from vctgi.clipmap.levels import WINDOW_MARGIN_VOXELS, ClipmapLayout
from vctgi.stages.cone_tracing.march import LEVEL_BLEND, ConeMarchConfig


def march(
    volume: HostVolume,
    apex: np.ndarray,
    axis: np.ndarray,
    ratio: float,
    phase: float,
    config: ConeMarchConfig,
) -> tuple[np.ndarray, float]:
    """Return radiance and transmittance."""
    layout = volume.layout
    begin, end = march_range(layout, apex, axis, ratio)
    start = config.start_offset_voxels * layout.finest_voxel_size
    t = max(begin, start * 2.0 ** finest_level(layout, apex))
    radiance, transmittance = np.zeros(3), 1.0
    while t < end and transmittance > config.min_transmittance:
        held = layout.finest_voxel_size * 2.0 ** finest_level(layout, apex + t * axis)
        step = max(config.step_ratio * ratio * t, config.min_step_voxels * held) * phase
        step = min(step, end - t)
        phase = 1.0
        middle = t + 0.5 * step
        extinction, source = read_at(volume, apex + middle * axis, axis, ratio * middle, config)
        if extinction > 0.0:
            stopped = 1.0 - math.exp(-extinction * step)
            radiance += transmittance * stopped * source / extinction
            transmittance *= 1.0 - stopped
        t += step
    return radiance, transmittance


def read_at(
    volume: HostVolume,
    point: np.ndarray,
    axis: np.ndarray,
    footprint: float,
    config: ConeMarchConfig,
) -> tuple[float, np.ndarray]:
    """Read the two levels around a footprint."""
    layout = volume.layout
    last = len(layout.levels) - 1
    wanted = math.log2(footprint / layout.finest_voxel_size) + config.level_bias
    level = min(max(wanted, finest_level(layout, point), 0.0), float(last))
    finer = min(int(level), max(last - 1, 0))
    blend = level - finer
    reads = []
    for each in (finer, min(finer + 1, last)):
        back = config.pull_back_voxels * layout.levels[each].voxel_size
        reads.append(read_medium(volume, each, point - back * axis, axis))
    (ext_near, src_near), (ext_far, src_far) = reads
    return (
        (1.0 - blend) * ext_near + blend * ext_far,
        (1.0 - blend) * src_near + blend * src_far,
    )


def finest_level(layout: ClipmapLayout, point: np.ndarray) -> float:
    """Return the finest level whose window holds a point, fractional in the rim."""
    last = layout.clip_level_count - 1
    if last == 0:
        return 0.0
    distance = float(np.max(np.abs(point - np.array(layout.centre))))
    half = (0.5 * layout.resolution - WINDOW_MARGIN_VOXELS) * layout.finest_voxel_size
    level = 0
    while distance > half * 2.0**level:
        level += 1
    share = distance / (half * 2.0**level)
    ramp = min(max((share - (1.0 - LEVEL_BLEND)) / LEVEL_BLEND, 0.0), 1.0)
    return min(level + ramp, float(last))


def march_range(
    layout: ClipmapLayout, apex: np.ndarray, axis: np.ndarray, ratio: float
) -> tuple[float, float]:
    """Where a cone enters the coarsest window, and one footprint behind where it leaves it."""
    enter, leave = -math.inf, math.inf
    for k in range(3):
        low = (layout.coarsest.window_min[k] - apex[k]) / axis[k]
        high = (layout.coarsest.window_max[k] - apex[k]) / axis[k]
        enter, leave = max(enter, min(low, high)), min(leave, max(low, high))
    if leave <= enter or leave <= 0.0:
        return 0.0, -1.0
    return max(enter, 0.0), leave * (1.0 + ratio)
