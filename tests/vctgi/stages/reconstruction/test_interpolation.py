"""Interpolated light: exact where it is even, bounded where it changes, kept on its surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.vctgi.stages.reconstruction.pictures import Plane, picture_of, pinhole, reconstruct
from vctgi.stages.reconstruction.config import ReconstructionConfig

pytestmark = pytest.mark.usefixtures("variant")

SIZE = 48

WALL = Plane((0.0, 0.0, 4.0), (0.0, 0.0, -1.0))
POLE = Plane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0))
GROUND = Plane((0.0, 0.2, 0.0), (0.0, -1.0, 0.0))
"""Ground seen at a grazing angle: the eye is a fifth of a unit above it."""

ROUNDING = 1e-6
"""Relative, of a normalised mean in single precision."""

LINEAR_ERROR = {4: 0.2, 9: 0.65, 16: 1.2}
"""Largest distance, in pixels along the gradient, between a pixel inside the picture and the mean
of the traced pixels that it takes. The pattern is not quite even: all pixels of a tile tried, it
comes to 0.15, 0.53 and 1.05; weights of depth add a little in a view as wide as this one. The
kernel ends at edge + 1/2 pixels, which bounds it in any case."""

SPARSITIES = [4, 9, 16]


@pytest.fixture(params=SPARSITIES)
def config(request: pytest.FixtureRequest) -> ReconstructionConfig:
    return ReconstructionConfig(sparsity=request.param)


def everywhere(value: float = 0) -> np.ndarray:
    return np.full((SIZE, SIZE), value)


def test_even_light_stays_even(config: ReconstructionConfig) -> None:
    found, alone = reconstruct(picture_of([WALL], everywhere(), everywhere(0.7)), config)
    np.testing.assert_allclose(found, 0.7, rtol=ROUNDING)
    assert alone == 0


def test_linear_light_on_a_plane_is_met_within_a_pixel(config: ReconstructionConfig) -> None:
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    for ramp in (x, y):
        found, alone = reconstruct(picture_of([WALL], everywhere(), 100.0 + ramp), config)
        error = np.abs(found - 100.0 - ramp)
        inside = slice(2 * config.edge, -2 * config.edge)
        assert error[inside, inside].max() <= LINEAR_ERROR[config.sparsity]
        # At the rim there are traced pixels on one side only.
        assert error.max() <= config.edge + 0.5
        assert alone == 0


def test_no_ray_takes_light_beyond_what_is_around_it(config: ReconstructionConfig) -> None:
    light = np.random.default_rng(3).uniform(0.0, 1.0, (SIZE, SIZE))
    found, _ = reconstruct(picture_of([WALL], everywhere(), light), config)
    assert found.min() >= light.min()
    assert found.max() <= light.max()


@pytest.mark.parametrize("width", [1, 2, 5])
def test_thin_pole_before_a_wall_does_not_smear(config: ReconstructionConfig, width: int) -> None:
    surface = everywhere(0)
    surface[:, 20 : 20 + width] = 1
    light = np.where(surface == 1, 5.0, 0.25)
    picture = picture_of([WALL, POLE], surface, light)
    found, alone = reconstruct(picture, config)
    np.testing.assert_allclose(found, light, rtol=ROUNDING)
    # Only the pole may have to help itself, and only where no traced pixel lies on it.
    assert alone <= SIZE * width
    assert picture.traced <= alone + (SIZE // config.edge) ** 2


def test_two_steps_of_a_stair_keep_their_light(config: ReconstructionConfig) -> None:
    upper = Plane((0.0, 0.1, 0.0), (0.0, -1.0, 0.0))
    direction, _ = pinhole(SIZE)
    with np.errstate(divide="ignore"):
        z = 0.2 / direction[..., 1] * direction[..., 2]
    surface = np.where(direction[..., 1] > 0.0, np.where(z < 1.0, 0, 1), -1)
    light = np.where(surface == 1, 2.0, 0.5)
    found, _ = reconstruct(picture_of([GROUND, upper], surface, light), config)
    seen = surface >= 0
    np.testing.assert_allclose(found[seen], light[seen], rtol=ROUNDING)


def test_grazing_ground_is_one_surface(config: ReconstructionConfig) -> None:
    direction, _ = pinhole(SIZE)
    is_ground = direction[..., 1] > 0.0
    surface = np.where(is_ground, 0, -1)
    picture = picture_of([GROUND], surface, np.where(is_ground, 0.3, 0.0))
    found, alone = reconstruct(picture, config)
    np.testing.assert_allclose(found[is_ground], 0.3, rtol=ROUNDING)
    # Next to the horizon neighbours are many times as far away, and rays are on their own.
    steep = direction[..., 1] > 8.0 * config.edge / SIZE
    assert alone <= np.count_nonzero(is_ground & ~steep)


def test_end_of_a_shadow_on_one_surface_is_traced(config: ReconstructionConfig) -> None:
    light = everywhere(1.0)
    light[:, SIZE // 2 :] = 0.01
    picture = picture_of([WALL], everywhere(), light)
    smeared, none = reconstruct(picture, config)
    found, alone = reconstruct(picture, replace(config, max_contrast=0.5))
    assert none == 0
    # Neighbours of two columns of blocks at most see both sides.
    assert 0 < alone <= 4 * config.edge * SIZE
    assert np.abs(found - light).mean() <= 0.5 * np.abs(smeared - light).mean()


def test_corner_of_two_walls_stays_sharp(config: ReconstructionConfig) -> None:
    side = Plane((1.0, 0.0, 4.0), (-1.0, 0.0, 0.0))
    direction, _ = pinhole(SIZE)
    surface = np.where(direction[..., 0] / direction[..., 2] > 0.25, 1, 0)
    light = np.where(surface == 1, 3.0, 1.0)
    found, _ = reconstruct(picture_of([WALL, side], surface, light), config)
    np.testing.assert_allclose(found, light, rtol=ROUNDING)


def test_every_ray_of_a_pixel_finds_its_own_surface(config: ReconstructionConfig) -> None:
    # The second rays of the pixels see the pole where the first see the wall, and the reverse.
    first, second = everywhere(0), everywhere(0)
    first[:, 10:20] = 1
    second[:, 12:22] = 1
    one, other = (
        picture_of([WALL, POLE], surface, np.where(surface == 1, 5.0, 0.25), shift)
        for surface, shift in ((first, 0.5), (second, 0.9))
    )
    found, alone = reconstruct(one, config, other)
    np.testing.assert_allclose(found, other.light, rtol=ROUNDING)
    # Only along the four edges that moved may too few neighbours be left.
    assert alone <= 4 * 2 * SIZE


def test_ray_without_any_neighbour_traces_for_itself(config: ReconstructionConfig) -> None:
    surface = everywhere(-1)
    surface[24:26, 24:26] = 0
    light = np.random.default_rng(1).uniform(1.0, 2.0, (SIZE, SIZE))
    strict = ReconstructionConfig(sparsity=config.sparsity, min_support=1.0)
    found, alone = reconstruct(picture_of([WALL], surface, light), strict)
    assert alone == 4
    np.testing.assert_allclose(found[24:26, 24:26], light[24:26, 24:26], rtol=ROUNDING)


def test_rays_that_meet_nothing_trace_nothing(config: ReconstructionConfig) -> None:
    picture = picture_of([WALL], everywhere(-1), everywhere(1.0))
    found, alone = reconstruct(picture, config)
    assert alone == 0
    assert picture.traced == 0
    assert not found.any()
