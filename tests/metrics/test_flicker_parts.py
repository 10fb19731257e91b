"""Noise and structure of flicker: a wall whose frames have both, each of known size."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics.flicker import Motion, flicker_rms, motion_of
from metrics.flicker_parts import flicker_noise, flicker_structure
from metrics.synthetic import sliding_motion

FRAMES, HEIGHT, WIDTH = 4, 24, 32
SEEDS, BATCHES = 4, 8
STEP_PX, STRUCTURE, NOISE, REFERENCE_NOISE = 0.4, 0.1, 0.05, 0.02

MIXED = 1.0 + STEP_PX**2 + (1.0 - STEP_PX) ** 2
"""Variance of the change of white noise: a pixel less a bilinear mix of two."""

CLOSE = 0.05
"""Relative, of a mean square over some thousand pixels."""

Arrays = tuple[NDArray[np.float64], NDArray[np.float64]]


@pytest.fixture(scope="module")
def motion() -> Motion:
    return sliding_motion(FRAMES, HEIGHT, WIDTH, STEP_PX)[0]


def drawn(structure: float, noise: float, seed: int = 0) -> Arrays:
    """Return renderings whose every other frame is brighter, and a reference of 1; both noisy."""
    generator = np.random.default_rng(seed)
    shape = (FRAMES, HEIGHT, WIDTH, 3)
    frames = np.ones(shape)
    frames[1::2] += structure
    renderings = frames + noise * generator.normal(size=(SEEDS, *shape))
    return renderings, 1.0 + REFERENCE_NOISE * generator.normal(size=(BATCHES, *shape))


def test_both_parts_are_found(motion: Motion) -> None:
    renderings, batches = drawn(STRUCTURE, NOISE)
    structure = flicker_structure(renderings, batches, motion).value
    noise = flicker_noise(renderings, batches, motion).value
    assert structure == pytest.approx(STRUCTURE, rel=CLOSE)
    assert noise == pytest.approx(NOISE * math.sqrt(MIXED), rel=CLOSE)
    # One rendering's flicker holds both.
    whole = flicker_rms(renderings[0], batches, motion).value
    assert whole == pytest.approx(math.hypot(structure, noise), rel=CLOSE)


@pytest.mark.parametrize("structure", [0.0, 0.03])
def test_intervals_hold_the_known_parts(motion: Motion, structure: float) -> None:
    draws = [drawn(structure, NOISE, seed) for seed in range(40)]
    for measure, known in (
        (flicker_structure, structure),
        (flicker_noise, NOISE * math.sqrt(MIXED)),
    ):
        inside = 0
        for renderings, batches in draws:
            found = measure(renderings, batches, motion)
            assert found.low is not None
            assert found.high is not None
            inside += found.low <= known <= found.high
        assert inside >= 0.85 * len(draws), measure.__name__


def test_frames_without_random_numbers_have_no_noise(motion: Motion) -> None:
    renderings, batches = drawn(STRUCTURE, 0.0)
    assert flicker_noise(renderings, batches, motion).value == pytest.approx(0.0, abs=1e-9)


def test_bad_input_is_refused(motion: Motion) -> None:
    renderings, batches = drawn(STRUCTURE, NOISE)
    for measure in (flicker_structure, flicker_noise):
        with pytest.raises(ValueError, match="S >= 3"):
            measure(renderings[:2], batches, motion)
        with pytest.raises(ValueError, match="M >= 4"):
            measure(renderings, batches[:3], motion)
        with pytest.raises(ValueError, match="hold light"):
            measure(renderings, 0.0 * batches, motion)
        broken = renderings.copy()
        broken[1, 2, 3, 4, 0] = np.nan
        with pytest.raises(ValueError, match="NaN"):
            measure(broken, batches, motion)


def test_a_lamp_just_below_the_ceiling_is_none_of_it() -> None:
    _, points = sliding_motion(FRAMES, HEIGHT, WIDTH, STEP_PX)
    points = points.copy()
    points[:, 8:12, 10:14, 2] = -0.05
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    offsets = STEP_PX * np.arange(FRAMES - 1)
    places = points[1:, ..., :2] - offsets[:, None, None, None] * np.array([1.0, 0.0])
    lamp = np.zeros(points.shape[:3], np.int64)
    lamp[:, 8:12, 10:14] = 1
    by_plane = motion_of(places, points, normals).is_followed
    by_surface = motion_of(places, points, normals, lamp).is_followed
    # A 20th of a pixel off the plane, it passes for the ceiling: the edge runs through its pixels.
    assert by_plane[0, 7:13, 8:14].all()
    assert not by_surface[0, 7:9, 8:14].any()
    assert by_surface[0, 14:-1, :-1].all()
    lamp[:] = -1
    lamp[:, 14:] = 0
    assert not motion_of(places, points, normals, lamp).is_followed[:, :14].any()
    with pytest.raises(ValueError, match="whole numbers"):
        motion_of(places, points, normals, lamp[1:])
