"""The march of one cone, as a plain loop in double precision."""

from __future__ import annotations

import math

import numpy as np

from tests.vctgi.twins.reading import (
    HostVolume,
    read_medium,
    read_sample,
    read_trilinear_medium,
)
from vctgi.clipmap.levels import WINDOW_MARGIN_VOXELS, ClipmapLayout
from vctgi.stages.cone_tracing.march import ConeMarchConfig
from vctgi.stages.cone_tracing.march_step import LEVEL_BLEND


def march(
    volume: HostVolume,
    apex: np.ndarray,
    axis: np.ndarray,
    ratio: float,
    phase: float,
    config: ConeMarchConfig,
    choice: tuple[float, np.ndarray | None] | None = None,
) -> tuple[np.ndarray, float, int]:
    """Return radiance, transmittance and the number of steps.

    A choice is the number that chooses levels, and the offset that chooses texels.
    """
    layout = volume.layout
    begin, end = march_range(layout, apex, axis, ratio)
    voxel_size = layout.finest_voxel_size
    if config.max_distance_voxels is not None:
        end = min(end, config.max_distance_voxels * voxel_size)
    if config.max_footprint_voxels is not None:
        end = min(end, config.max_footprint_voxels * voxel_size / ratio)
    start = config.start_offset_voxels * layout.finest_voxel_size
    t = max(begin, start * 2.0 ** finest_level(layout, apex))
    radiance, transmittance, count = np.zeros(3), 1.0, 0
    while t < end and transmittance > config.min_transmittance:
        held = layout.finest_voxel_size * 2.0 ** finest_level(layout, apex + t * axis)
        wanted = config.step_ratio * ratio * t
        if config.step_rule == "spheres":
            # The next sphere begins where this one ends.
            half = min(0.5 * ratio, 0.9)
            wanted = t * (1.0 + half) / (1.0 - half) - t
        step = max(wanted, config.min_step_voxels * held) * phase
        step = min(step, end - t)
        phase = 1.0
        place = t + config.sample_place * step
        point = apex + place * axis
        stopped, seen = step_at(volume, point, axis, ratio * place, step, config, choice)
        radiance += transmittance * seen
        transmittance *= 1.0 - stopped
        t += step
        count += 1
    return radiance, transmittance, count


def step_at(
    volume: HostVolume,
    point: np.ndarray,
    axis: np.ndarray,
    footprint: float,
    step: float,
    config: ConeMarchConfig,
    choice: tuple[float, np.ndarray | None] | None = None,
) -> tuple[float, np.ndarray]:
    """Return what a step stops and adds, from the two levels around a footprint, or one of them."""
    layout = volume.layout
    last = len(layout.levels) - 1
    wanted = math.log2(footprint / layout.finest_voxel_size) + config.level_bias
    level = min(max(wanted, finest_level(layout, point), 0.0), float(last))
    finer = min(int(level), max(last - 1, 0))
    blend = level - finer
    reads = []
    for each in (finer, min(finer + 1, last)):
        back = config.pull_back_voxels * layout.levels[each].voxel_size
        reads.append(read(volume, each, point - back * axis, axis, config))
    if choice is not None:
        chosen = min(int(level + choice[0]), last)
        back = config.pull_back_voxels * layout.levels[chosen].voxel_size
        place = point - back * axis
        if choice[1] is not None:
            # The middle of the chosen voxel, where a linear read gives it alone.
            size = layout.levels[chosen].voxel_size
            place = size * (np.floor(place / size - 0.5 + choice[1]) + 0.5)
        reads = [read(volume, chosen, place, axis, config)] * 2
    (near, near_color), (far, far_color) = reads
    value = (1.0 - blend) * near + blend * far
    color = (1.0 - blend) * near_color + blend * far_color
    if value == 0.0:
        return 0.0, np.zeros(3)
    if config.correction == "depth":
        stopped = 1.0 - math.exp(-value * step)
        return stopped, stopped * color / value
    voxels = config.correction_factor * step / (layout.finest_voxel_size * 2.0**level)
    stopped = {
        "exponent": 1.0 - (1.0 - value) ** voxels,
        "linear": min(voxels * value, 1.0),
        "none": value,
    }[config.correction]
    return stopped, color * (voxels if config.color == "proportional" else stopped / value)


def read(
    volume: HostVolume, level: int, point: np.ndarray, axis: np.ndarray, config: ConeMarchConfig
) -> tuple[float, np.ndarray]:
    """Read one level: extinction and source, or opacity and emittance."""
    if config.correction != "depth":
        return read_sample(volume, level, point, axis, config.weights)
    if config.read == "trilinear":
        return read_trilinear_medium(volume, level, point, axis, config.weights)
    return read_medium(volume, level, point, axis)


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
