"""Voxel volumes and surfaces that are written down rather than rendered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mitsuba as mi
import numpy as np

from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume, pack_volume
from vctgi.clipmap.texture import TextureTexels
from vctgi.maths.directions import DIRECTION_COUNT


def opacity_of(layout: ClipmapLayout, levels: Sequence[np.ndarray]) -> OpacityClipmap:
    """Opacities [direction, z, y, x] of each level."""
    return OpacityClipmap(layout, [mi.Float(np.float32(a).ravel()) for a in levels])


def emittance_of(layout: ClipmapLayout, levels: Sequence[np.ndarray]) -> EmittanceClipmap:
    """Emittances [direction, z, y, x, 3] of each level."""
    flat = [np.float32(c).reshape(-1, 3).T for c in levels]
    return EmittanceClipmap(
        layout,
        [mi.Color3f(np.ascontiguousarray(c)) for c in flat],
        [0.0] * layout.clip_level_count,
    )


def stored_numbers(volume: VoxelVolume) -> np.ndarray:
    """All that a volume stores: its words, or the texels of its texture."""
    texels = volume.texels
    if isinstance(texels, GatheredTexels):
        return np.array(texels.words)
    assert isinstance(texels, TextureTexels)
    tensor: Any = texels.texture
    return np.array(tensor.tensor())


def random_values(
    layout: ClipmapLayout, seed: int, empty_share: float = 0.5
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Opacities in steps of 1/64 and premultiplied emittances of every level."""
    rng = np.random.default_rng(seed)
    alphas, colors = [], []
    for level in layout.levels:
        shape = (DIRECTION_COUNT,) + (level.resolution,) * 3
        alpha = rng.integers(0, 65, shape) / 64.0
        alpha[rng.random(shape) < empty_share] = 0.0
        alphas.append(alpha)
        colors.append(alpha[..., None] * rng.uniform(0.0, 2.0, (*shape, 3)))
    return alphas, colors


def homogeneous_volume(
    layout: ClipmapLayout, extinction: float, radiance: float = 1.0
) -> VoxelVolume:
    """Fog of one extinction (per world unit, along an axis) that glows with one radiance."""

    def opacity(level: LevelLayout) -> float:
        return float(-np.expm1(-extinction * level.voxel_size))

    shapes = [(DIRECTION_COUNT,) + (level.resolution,) * 3 for level in layout.levels]
    alphas = [
        np.full(shape, opacity(level)) for shape, level in zip(shapes, layout.levels, strict=True)
    ]
    colors = [np.repeat(radiance * a[..., None], 3, axis=-1) for a in alphas]
    return pack_volume(opacity_of(layout, alphas), emittance_of(layout, colors))
