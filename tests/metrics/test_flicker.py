"""Flicker: a wall seen by an eye that slides along it, whose light is known in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics.flicker import Motion, changes, flicker, flicker_rms, motion_of
from metrics.measurement import Measurement

FRAMES, HEIGHT, WIDTH, BATCHES = 5, 24, 32, 6
STEP_PX = 0.4

ROUNDING = 1e-9
"""Sums of a few thousand float64 values near 1."""

NOISE = 0.02
"""Of one batch, relative."""


@dataclass(frozen=True)
class Slide:
    """The wall's points in each frame, where they were, and a light that grows along the wall."""

    motion: Motion
    truth: NDArray[np.float64]

    def batches(self, noise: float = NOISE, seed: int = 0) -> NDArray[np.float64]:
        rng = np.random.default_rng(seed)
        return self.truth * (1.0 + noise * rng.normal(size=(BATCHES, *self.truth.shape)))


def slide_positions() -> NDArray[np.float64]:
    """Points of the plane z = 0 that pixels see, the eye sliding along x."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    still = np.stack([x, y, np.zeros_like(x)], axis=-1)
    return np.stack([still + np.array([STEP_PX * k, 0.0, 0.0]) for k in range(FRAMES)])


def slide_normals() -> NDArray[np.float64]:
    return np.broadcast_to([0.0, 0.0, 1.0], (FRAMES, HEIGHT, WIDTH, 3)).copy()


def slide_places() -> NDArray[np.float64]:
    return np.stack([p[..., :2] - [STEP_PX * k, 0.0] for k, p in enumerate(slide_positions()[1:])])


@pytest.fixture(scope="module")
def slide() -> Slide:
    points = slide_positions()
    motion = motion_of(slide_places(), points, slide_normals())
    light = 1.0 + 0.02 * points[..., 0] - 0.01 * points[..., 1]
    return Slide(motion, np.repeat(light[..., None], 3, axis=-1))


def holds(found: Measurement, expected: float) -> bool:
    assert found.low is not None
    assert found.high is not None
    return found.low - ROUNDING <= expected <= found.high + ROUNDING


def test_light_of_a_wall_is_followed_exactly(slide: Slide) -> None:
    # Bilinear interpolation is exact on a plane of light.
    np.testing.assert_allclose(changes(slide.truth, slide.motion), 0.0, atol=ROUNDING)
    seen = slide.motion.is_followed
    # What slid in at the right is seen for the first time; all else was seen before.
    assert seen[:, :-1, :-1].all()
    assert not seen[:, :, -1].any()


def test_edges_and_turned_surfaces_are_not_followed() -> None:
    points, normals = slide_positions(), slide_normals()
    points[0, :, 16:, 2] = -9.0
    normals[1, :, :8] = [1.0, 0.0, 0.0]
    normals[2, :, 20:] = 0.0
    followed = motion_of(slide_places(), points, normals).is_followed
    assert not followed[0, :, 15:].any()
    # Nor what lies beside an edge, as one may run through its pixel
    assert not followed[0, :, :9].any()
    assert followed[0, :-1, 9:14].all()
    assert not followed[1, :, 19:].any()


def test_flicker_of_known_size(slide: Slide) -> None:
    # Whole frames that are a tenth brighter in turn: each change is a tenth of the light there.
    found = slide.truth.copy()
    found[1::2] *= 1.1
    batches = np.stack([slide.truth] * BATCHES)
    by_hand = np.abs(changes(found, slide.motion)).mean() / slide.truth.mean()
    assert flicker(found, batches, slide.motion).value == pytest.approx(by_hand, rel=ROUNDING)
    assert flicker(found, batches, slide.motion).value == pytest.approx(0.1, rel=0.05)
    assert flicker_rms(found, batches, slide.motion).value == pytest.approx(0.1, rel=0.05)


def test_white_noise_of_known_size(slide: Slide) -> None:
    # The change is the difference of one pixel and a bilinear mix of two: 1 + a^2 + (1 - a)^2.
    sigma, share = 0.05, STEP_PX % 1.0
    flat = np.ones_like(slide.truth)
    noisy = flat + sigma * np.random.default_rng(5).normal(size=flat.shape)
    found = flicker_rms(noisy, np.stack([flat] * BATCHES), slide.motion)
    expected = sigma * np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    assert found.value == pytest.approx(expected, rel=0.05)


def test_reference_itself_does_not_flicker(slide: Slide) -> None:
    for measure in (flicker, flicker_rms):
        inside = [
            holds(measure(slide.truth, slide.batches(seed=seed), slide.motion), 0.0)
            for seed in range(20)
        ]
        assert np.mean(inside) >= 0.85


def test_noise_of_the_reference_stays_within_the_interval(slide: Slide) -> None:
    found = slide.truth * (1.0 + 0.05 * np.random.default_rng(7).normal(size=slide.truth.shape))
    for measure in (flicker, flicker_rms):
        exact = measure(found, np.stack([slide.truth] * BATCHES), slide.motion).value
        inside = [
            holds(measure(found, slide.batches(seed=seed), slide.motion), exact)
            for seed in range(20)
        ]
        assert np.mean(inside) >= 0.85


def test_flicker_grows_with_its_cause(slide: Slide) -> None:
    noise = np.random.default_rng(9).normal(size=slide.truth.shape)
    for measure in (flicker, flicker_rms):
        values = [
            measure(slide.truth * (1.0 + s * noise), slide.batches(), slide.motion).value
            for s in (0.0, 0.02, 0.05, 0.1)
        ]
        assert values == sorted(values)


def test_planted_faults_are_found(slide: Slide) -> None:
    one_brighter = slide.truth.copy()
    one_brighter[2] *= 1.05
    found = flicker_rms(one_brighter, slide.batches(), slide.motion)
    assert found.low is not None
    assert found.low > 0.02
    late = np.concatenate([slide.truth[:1], slide.truth[:-1]])
    lagging = flicker_rms(late, np.stack([slide.truth] * BATCHES), slide.motion)
    assert lagging.value > 0.0
    broken = slide.truth.copy()
    broken[1, 2, 3, 0] = np.nan
    for measure in (flicker, flicker_rms):
        with pytest.raises(ValueError, match="NaN"):
            measure(broken, slide.batches(), slide.motion)


def test_bad_input_is_refused(slide: Slide) -> None:
    points, normals, places = slide_positions(), slide_normals(), slide_places()
    with pytest.raises(ValueError, match="K >= 2"):
        motion_of(places[:0], points[:1], normals[:1])
    with pytest.raises(ValueError, match="places must be"):
        motion_of(places[1:], points, normals)
    with pytest.raises(ValueError, match="places must be finite"):
        motion_of(np.nan * places, points, normals)
    with pytest.raises(ValueError, match="smaller steps"):
        motion_of(places + 1e3, points, normals)
    with pytest.raises(ValueError, match="frames must be"):
        changes(slide.truth[1:], slide.motion)
    with pytest.raises(ValueError, match="M >= 2"):
        flicker(slide.truth, slide.truth[None], slide.motion)
    with pytest.raises(ValueError, match="hold light"):
        flicker_rms(slide.truth, 0.0 * slide.batches(), slide.motion)
