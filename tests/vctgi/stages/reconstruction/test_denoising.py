"""The filter of specular cones: what it must keep, what it must remove, what it must not cross."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from vctgi.scene.records import FilmSample, GBuffer
from vctgi.stages.cone_tracing.specular import blue_noise_phase
from vctgi.stages.reconstruction.denoising import (
    SpecularFilter,
    SpecularFilterConfig,
    filter_specular,
)

pytestmark = pytest.mark.usefixtures("variant")

WIDTH, HEIGHT = 24, 20

ROUNDING = 1e-5

MEAN_KEPT = 0.01
"""Relative. Weights are normalised for each pixel, not for each tap, so a mean is kept only as far
as edges lie evenly."""

CROSSED = 1e-3
"""Share of a step that crosses an edge: the weights there are exp(-12) and less."""

SMALL = 0.01
"""Full apex angle that is traced for mirrors, radians."""


def floor_pixels(depth_step: float = 0.0) -> GBuffer:
    """Pixels over a plane z = 0, whose right half lies nearer by a step."""
    y, x = (each.ravel().astype(np.float32) for each in np.mgrid[0:HEIGHT, 0:WIDTH])
    z = np.where(x >= WIDTH // 2, depth_step, 0.0).astype(np.float32)
    count = WIDTH * HEIGHT
    gbuffer = dr.zeros(GBuffer, count)
    gbuffer.is_valid = dr.full(mi.Bool, True, count)
    gbuffer.position = mi.Point3f(mi.Float(0.1 * x), mi.Float(0.1 * y), mi.Float(z))
    gbuffer.normal = dr.zeros(mi.Vector3f, count) + mi.Vector3f(0.0, 0.0, 1.0)
    gbuffer.specular_axis = mi.Vector3f(gbuffer.normal)
    gbuffer.specular_aperture = dr.full(mi.Float, 0.4, count)
    gbuffer.specular_albedo = dr.full(mi.Color3f, 0.5, count)
    return gbuffer


def is_right() -> np.ndarray:
    x = np.mgrid[0:HEIGHT, 0:WIDTH][1]
    right: np.ndarray = x >= WIDTH // 2
    return right


def filtered(picture: np.ndarray, gbuffer: GBuffer, kind: SpecularFilter) -> np.ndarray:
    flat = mi.Float(np.ascontiguousarray(picture.ravel(), dtype=np.float32))
    radiance = mi.Color3f(flat, flat, flat)
    found = filter_specular(radiance, gbuffer, WIDTH, SMALL, SpecularFilterConfig(kind=kind))
    values: np.ndarray = np.array(found, dtype=np.float64)[1].reshape(HEIGHT, WIDTH)
    return values


def noise() -> np.ndarray:
    return np.random.default_rng(1).random((HEIGHT, WIDTH))


@pytest.mark.parametrize("kind", ["none", "box4", "bilateral"])
def test_constant_stays_constant(kind: SpecularFilter) -> None:
    found = filtered(np.full((HEIGHT, WIDTH), 3.0), floor_pixels(depth_step=0.7), kind)
    np.testing.assert_allclose(found, 3.0, rtol=ROUNDING)


@pytest.mark.parametrize("kind", ["box4", "bilateral"])
def test_noise_of_the_pattern_vanishes_up_to_the_rim(kind: SpecularFilter) -> None:
    phase = np.array(blue_noise_phase(FilmSample(WIDTH), WIDTH * HEIGHT)).reshape(HEIGHT, WIDTH)
    # Any function of the phase becomes its mean over the 16 phases.
    found = filtered(np.sin(7.0 * phase), floor_pixels(), kind)
    expected = np.sin(7.0 * (np.arange(16) + 0.5) / 16.0).mean()
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


@pytest.mark.parametrize("depth_step", [0.0, 0.7])
def test_mean_is_kept(depth_step: float) -> None:
    picture = noise()
    found = filtered(picture, floor_pixels(depth_step), "bilateral")
    assert found.mean() == pytest.approx(picture.mean(), rel=MEAN_KEPT)
    assert found.std() < 0.4 * picture.std()


def change_depth(_gbuffer: GBuffer) -> GBuffer:
    return floor_pixels(depth_step=5.0)


def change_normal(gbuffer: GBuffer) -> GBuffer:
    right = mi.Bool(is_right().ravel())
    gbuffer.normal = dr.select(right, mi.Vector3f(1.0, 0.0, 0.0), gbuffer.normal)
    return gbuffer


def change_roughness(gbuffer: GBuffer) -> GBuffer:
    right = mi.Bool(is_right().ravel())
    gbuffer.specular_aperture = dr.select(right, SMALL, gbuffer.specular_aperture)
    return gbuffer


def change_axis(gbuffer: GBuffer) -> GBuffer:
    right = mi.Bool(is_right().ravel())
    gbuffer.specular_axis = dr.select(right, mi.Vector3f(0.8, 0.0, 0.6), gbuffer.specular_axis)
    return gbuffer


@pytest.mark.parametrize("change", [change_depth, change_normal, change_roughness, change_axis])
def test_edges_are_not_crossed(change) -> None:  # type: ignore[no-untyped-def]  # one of four
    gbuffer = change(floor_pixels())
    picture = np.where(is_right(), 1.0, 0.0)
    found = filtered(picture, gbuffer, "bilateral")
    np.testing.assert_allclose(found, picture, atol=CROSSED)
    # The plain mean does cross them.
    assert np.abs(filtered(picture, gbuffer, "box4") - picture).max() > 0.3


def test_surfaces_without_lobes_neither_give_nor_take() -> None:
    gbuffer = floor_pixels()
    right = mi.Bool(is_right().ravel())
    gbuffer.specular_albedo = dr.select(right, 0.0, gbuffer.specular_albedo)
    picture = np.where(is_right(), 100.0, 2.0)
    for kind in ("box4", "bilateral"):
        found = filtered(picture, gbuffer, kind)
        np.testing.assert_allclose(found, picture, rtol=ROUNDING)


def test_mirrors_stay_sharp_where_pixels_are_wide() -> None:
    gbuffer = floor_pixels()
    gbuffer.specular_aperture = dr.full(mi.Float, 0.0, WIDTH * HEIGHT)
    x = mi.Float((0.02 * np.mgrid[0:HEIGHT, 0:WIDTH][1]).ravel().astype(np.float32))
    gbuffer.specular_axis = dr.normalize(mi.Vector3f(x, 0.0, 1.0))
    picture = np.where(is_right(), 1.0, 0.0)
    np.testing.assert_allclose(filtered(picture, gbuffer, "bilateral"), picture, atol=CROSSED)


def test_mirrored_picture_is_filtered_to_the_mirror_image() -> None:
    picture = noise()
    found = filtered(picture, floor_pixels(), "bilateral")
    turned = filtered(picture[:, ::-1], floor_pixels(), "bilateral")
    np.testing.assert_allclose(turned[:, ::-1], found, atol=ROUNDING)


@pytest.mark.parametrize(
    ("change", "words"),
    [({"kind": "median"}, "kind must be one of"), ({"plane_width": 0.0}, "plane_width must be")],
)
def test_filters_that_do_not_exist_are_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        SpecularFilterConfig(**change)  # type: ignore[arg-type]  # wrong on purpose
