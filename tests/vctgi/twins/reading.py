"""The layered read of one point and the read of a surface's own layer, in double precision."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from tests.vctgi.twins.downsampling import address, is_held
from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.sampling import OPTICAL_DEPTH_CAP
from vctgi.clipmap.slots import BEHIND_NUDGE
from vctgi.maths.directions import other_axes


@dataclass
class HostVolume:
    """Opacities [direction, z, y, x] and emittances [.., 3] of each level."""

    layout: ClipmapLayout
    alphas: list[np.ndarray]
    colors: list[np.ndarray]


def read_medium(
    volume: HostVolume, level: int, point: np.ndarray, direction: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return extinction and source per world unit."""
    layout = volume.layout.levels[level]
    place = point / layout.voxel_size - 0.5
    lowest = np.floor(place).astype(int)
    fraction = place - lowest
    extinction, source = 0.0, np.zeros(3)
    for axis in range(3):
        u, v = other_axes(axis)
        slot = 2 * axis + (1 if direction[axis] < 0.0 else 0)
        share = abs(direction[axis]) / layout.voxel_size
        for along in range(2):
            alpha, color = 0.0, np.zeros(3)
            for step_u, step_v in itertools.product(range(2), repeat=2):
                step = np.zeros(3, int)
                step[axis], step[u], step[v] = along, step_u, step_v
                if not is_held(lowest + step, layout):
                    continue
                weights = np.where(step == 1, fraction, 1.0 - fraction)
                where = (slot, *address(lowest + step, layout))
                alpha += weights[u] * weights[v] * volume.alphas[level][where]
                color += weights[u] * weights[v] * volume.colors[level][where]
            if (
                alpha == 0.0
                or not 0 <= lowest[axis] + along - layout.origin[axis] < layout.resolution
            ):
                continue
            weight = fraction[axis] if along else 1.0 - fraction[axis]
            depth = (
                min(-math.log1p(-alpha), OPTICAL_DEPTH_CAP) if alpha < 1.0 else OPTICAL_DEPTH_CAP
            )
            extinction += share * weight * depth
            source += share * weight * depth * color / alpha
    return extinction, source


def read_sample(
    volume: HostVolume, level: int, point: np.ndarray, direction: np.ndarray, weights: str
) -> tuple[float, np.ndarray]:
    """Return trilinear opacity and emittance of the slots that face a ray."""
    opacity, emitted = 0.0, np.zeros(3)
    for axis, share in enumerate(axis_shares(direction, weights)):
        alpha, color = trilinear(volume, level, point, axis, direction[axis] < 0.0)
        opacity += share * alpha
        emitted += share * color
    return min(opacity, 1.0), emitted


def read_trilinear_medium(
    volume: HostVolume, level: int, point: np.ndarray, direction: np.ndarray, weights: str
) -> tuple[float, np.ndarray]:
    """Return extinction and source per world unit, of opacity interpolated as alpha."""
    extinction, source = 0.0, np.zeros(3)
    for axis, share in enumerate(axis_shares(direction, weights)):
        alpha, color = trilinear(volume, level, point, axis, direction[axis] < 0.0)
        if alpha == 0.0:
            continue
        depth = min(-math.log1p(-alpha), OPTICAL_DEPTH_CAP) if alpha < 1.0 else OPTICAL_DEPTH_CAP
        per_length = share / volume.layout.levels[level].voxel_size
        extinction += per_length * depth
        source += per_length * depth * color / alpha
    return extinction, source


def axis_shares(direction: np.ndarray, weights: str) -> np.ndarray:
    """How much the slots along each axis count."""
    projected = np.abs(direction)
    shares: np.ndarray = {
        "projected": projected,
        "squared": direction**2,
        "normalised": projected / projected.sum(),
    }[weights]
    return shares


def trilinear(
    volume: HostVolume, level: int, point: np.ndarray, axis: int, is_downwards: bool
) -> tuple[float, np.ndarray]:
    """Opacity and emittance of one axis' slots, interpolated over eight voxels."""
    layout = volume.layout.levels[level]
    place = point / layout.voxel_size - 0.5
    lowest = np.floor(place).astype(int)
    fraction = place - lowest
    alpha, color = 0.0, np.zeros(3)
    for steps in itertools.product(range(2), repeat=3):
        step = np.array(steps)
        if not is_held(lowest + step, layout):
            continue
        weight = float(np.prod(np.where(step == 1, fraction, 1.0 - fraction)))
        where = (2 * axis + int(is_downwards), *address(lowest + step, layout))
        alpha += weight * volume.alphas[level][where]
        color += weight * volume.colors[level][where]
    return alpha, color


def read_surface(
    volume: HostVolume, level: int, point: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return radiance and opacity of a surface point in the layers that it was written to."""
    layout = volume.layout.levels[level]
    place = point / layout.voxel_size
    lowest = np.floor(place - 0.5).astype(int)
    fraction = place - 0.5 - lowest
    alpha, color = 0.0, np.zeros(3)
    for axis in range(3):
        u, v = other_axes(axis)
        slot, behind = (2 * axis, 1.0) if normal[axis] < 0.0 else (2 * axis + 1, -1.0)
        layer = int(np.floor(place[axis] + behind * BEHIND_NUDGE))
        for step_u, step_v in itertools.product(range(2), repeat=2):
            voxel = lowest.copy()
            voxel[axis], voxel[u], voxel[v] = layer, lowest[u] + step_u, lowest[v] + step_v
            if not is_held(voxel, layout):
                continue
            weight_u = fraction[u] if step_u else 1.0 - fraction[u]
            weight_v = fraction[v] if step_v else 1.0 - fraction[v]
            weight = abs(normal[axis]) * weight_u * weight_v
            where = (slot, *address(voxel, layout))
            alpha += weight * volume.alphas[level][where]
            color += weight * volume.colors[level][where]
    return (color / alpha if alpha > 0.0 else color), alpha
