"""Downsampling equals its slow twin, and keeps what one radiance and one slanted plane are."""

from __future__ import annotations

import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of, random_values
from tests.vctgi.twins.downsampling import downsample_level
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.downsampling import DownsamplingConfig, downsample

pytestmark = pytest.mark.usefixtures("variant")

SINGLE_PRECISION_SUM = 1e-6
"""Relative rounding of a mean of eight numbers of order 1, five levels deep."""


def layout() -> ClipmapLayout:
    return lay_out_clipmap((0.4, -3.0, 2.0), finest_voxel_size=0.5, level_count=2, resolution=8)


def on_host(
    alphas: list[np.ndarray], colors: list[np.ndarray]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    where = layout()
    opacity, emittance = downsample(opacity_of(where, alphas), emittance_of(where, colors))
    assert emittance is not None
    shapes = [a.shape for a in alphas]
    return (
        [np.array(a).reshape(s) for a, s in zip(opacity.levels, shapes, strict=True)],
        [np.array(c).T.reshape(*s, 3) for c, s in zip(emittance.levels, shapes, strict=True)],
    )


@pytest.mark.parametrize("seed", range(3))
def test_equals_the_twin(seed: int) -> None:
    alphas, colors = random_values(layout(), seed)
    found_alpha, found_color = on_host(alphas, colors)
    twin = [(alphas[0].astype(np.float32), colors[0].astype(np.float32))]
    for finer, coarser in zip(layout().levels[:-1], layout().levels[1:], strict=True):
        own = (alphas[coarser.level].astype(np.float32), colors[coarser.level].astype(np.float32))
        twin.append(downsample_level(finer, coarser, twin[-1], own))
    for level, (alpha, color) in enumerate(twin):
        np.testing.assert_allclose(found_alpha[level], alpha, atol=SINGLE_PRECISION_SUM)
        np.testing.assert_allclose(found_color[level], color, atol=4.0 * SINGLE_PRECISION_SUM)


def test_opacity_stays_in_its_range_and_one_radiance_stays_one_radiance() -> None:
    alphas, _ = random_values(layout(), 7, empty_share=0.3)
    found_alpha, found_color = on_host(alphas, [np.repeat(a[..., None], 3, -1) for a in alphas])
    for alpha, color in zip(found_alpha, found_color, strict=True):
        assert alpha.min() >= 0.0
        assert alpha.max() <= 1.0 + SINGLE_PRECISION_SUM
        # Premultiplied emittance of radiance 1 is the opacity itself.
        np.testing.assert_allclose(color, alpha[..., None].repeat(3, -1), atol=SINGLE_PRECISION_SUM)


def test_parts_of_a_slanted_plane_add_up() -> None:
    # Two voxels of a column share a plane that covers a column once: 3/8 and 5/8.
    where = layout()
    alphas = [np.zeros((DIRECTION_COUNT,) + (level.resolution,) * 3) for level in where.levels]
    colors = [np.zeros((*a.shape, 3)) for a in alphas]
    alphas[0][4:, 0::2], alphas[0][4:, 1::2] = 0.375, 0.625
    found_alpha, _ = on_host(alphas, colors)
    coarse = found_alpha[1][4:]
    assert np.all((coarse == 0.0) | (coarse == 1.0))
    assert np.count_nonzero(coarse) == 2 * 4**3


def test_mips_are_made_although_they_start_empty() -> None:
    alphas, colors = random_values(layout(), 3, empty_share=0.0)
    alphas = [np.maximum(a, 1.0 / 64.0) for a in alphas]
    for level in layout().levels[2:]:
        alphas[level.level][:] = 0.0
        colors[level.level][:] = 0.0
    found_alpha, _ = on_host(alphas, colors)
    assert all((alpha > 0.0).all() for alpha in found_alpha)


def test_averaging_mips_are_the_mean_of_eight_children() -> None:
    where = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=1, resolution=16)
    alphas, colors = random_values(where, seed=8)
    config = DownsamplingConfig(mips="average")
    opacity, emittance = downsample(opacity_of(where, alphas), emittance_of(where, colors), config)
    assert emittance is not None
    alpha, color = alphas[0], colors[0]
    for level in where.levels[1:]:
        half = level.resolution
        # Windows are aligned, so that blocks of storage are blocks of the world.
        shape = (6, half, 2, half, 2, half, 2)
        alpha = alpha.reshape(shape).mean(axis=(2, 4, 6))
        color = color.reshape(*shape, 3).mean(axis=(2, 4, 6))
        found = np.array(opacity.levels[level.level]).reshape(alpha.shape)
        np.testing.assert_allclose(found, alpha, atol=1e-6)
        found = np.array(emittance.levels[level.level]).T.reshape(color.shape)
        np.testing.assert_allclose(found, color, atol=1e-6)


def test_isotropic_voxels_are_as_closed_as_their_most_closed_side() -> None:
    where = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=1, resolution=8)
    alphas, colors = random_values(where, seed=9)
    opacity, emittance = downsample(
        opacity_of(where, alphas),
        emittance_of(where, colors),
        DownsamplingConfig(mips="average", is_isotropic=True),
    )
    assert emittance is not None
    largest = alphas[0].max(axis=0)
    total = alphas[0].sum(axis=0)
    radiance = colors[0].sum(axis=0) / np.maximum(total, 1e-9)[..., None]
    found = np.array(opacity.levels[0]).reshape(alphas[0].shape)
    lit = np.array(emittance.levels[0]).T.reshape(colors[0].shape)
    for direction in range(6):
        np.testing.assert_allclose(found[direction], largest, atol=1e-6)
        np.testing.assert_allclose(lit[direction], largest[..., None] * radiance, atol=1e-5)


def test_unknown_mips_are_refused() -> None:
    with pytest.raises(ValueError, match="must be one of"):
        DownsamplingConfig(mips="largest")  # type: ignore[arg-type]
