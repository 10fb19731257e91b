from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics.banding import TILE_EDGE, phase_spread, structured_power, structured_share
from metrics.synthetic import march_cycles

SIZE = 64

ROUNDING = 1e-9
"""Sums of a few thousand float64 values near 1."""

BY_CHANCE = 0.02
"""Share of 4096 pixels of white noise that 64 waves explain beyond their expectation: standard
deviation near 0.003."""


def cycles(per_pixel: float, degrees: float = 30.0) -> NDArray[np.float64]:
    """Phase of a march whose bands have this frequency and direction."""
    return march_cycles(SIZE, per_pixel, degrees)


def bands(per_pixel: float, harmonic: int = 1, degrees: float = 30.0) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.sin(2.0 * np.pi * harmonic * cycles(per_pixel, degrees) + 0.7)
    return found


def noise(seed: int = 1) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(size=(SIZE, SIZE))


@pytest.mark.parametrize("per_pixel", [0.1, 0.2, 0.45])
@pytest.mark.parametrize("harmonic", [1, 2])
def test_bands_are_all_structure(per_pixel: float, harmonic: int) -> None:
    picture = bands(per_pixel, harmonic)
    assert structured_share(picture, cycles(per_pixel)) == pytest.approx(1.0, abs=ROUNDING)
    # A slow wave gives some of its power to the mean and slope that are taken off
    assert 0.3 < structured_power(picture, cycles(per_pixel)) < 0.55


def test_white_noise_has_no_structure() -> None:
    shares = [structured_share(noise(seed), cycles(0.2)) for seed in range(8)]
    assert abs(np.mean(shares)) < BY_CHANCE
    assert np.mean([structured_power(noise(seed), cycles(0.2)) for seed in range(8)]) < BY_CHANCE


def test_bands_in_noise_are_found_at_their_power() -> None:
    picture = 0.5 * bands(0.2) + noise()
    alone = structured_power(0.5 * bands(0.2), cycles(0.2))
    assert structured_power(picture, cycles(0.2)) == pytest.approx(alone, rel=0.2)


def test_power_grows_as_the_square() -> None:
    first, second = (structured_power(k * bands(0.2), cycles(0.2)) for k in (1.0, 3.0))
    assert second == pytest.approx(9.0 * first, rel=ROUNDING)


def test_waves_of_another_frequency_or_direction_are_not_bands() -> None:
    for other in (bands(0.33), bands(0.2, degrees=120.0)):
        assert structured_share(other, cycles(0.2)) < 0.1


def test_flat_and_sloped_pictures_have_no_bands() -> None:
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    for picture in (np.zeros((SIZE, SIZE)), np.ones((SIZE, SIZE)), 0.1 * x - 0.2 * y + 3.0):
        assert structured_power(picture, cycles(0.2)) == pytest.approx(0.0, abs=ROUNDING)
    assert structured_share(np.zeros((SIZE, SIZE)), cycles(0.2)) == 0.0


def test_what_the_mask_leaves_out_does_not_count() -> None:
    mask = np.zeros((SIZE, SIZE), dtype=np.bool_)
    mask[:, : 2 * TILE_EDGE] = True
    picture = np.where(mask, bands(0.2), np.nan)
    assert structured_share(picture, cycles(0.2), mask) == pytest.approx(1.0, abs=ROUNDING)


def test_marches_that_bands_cannot_show_are_refused() -> None:
    for per_pixel in (0.01, 0.8):
        with pytest.raises(ValueError, match="no tile"):
            structured_power(noise(), cycles(per_pixel))


def test_phase_spread_is_that_of_the_bands() -> None:
    # Bands that move by 1/8 of a cycle from phase to phase: a sine of K even phases has a variance
    # of K / (K - 1) / 2.
    x = np.mgrid[0:SIZE, 0:SIZE][1]
    count, strength, mean = 8, 0.1, 2.0
    pictures = [mean + strength * np.sin(2.0 * np.pi * (0.2 * x + k / count)) for k in range(count)]
    expected = strength * np.sqrt(0.5 * count / (count - 1)) / mean
    assert phase_spread(pictures) == pytest.approx(expected, rel=1e-3)
    coloured = np.repeat(np.array(pictures)[..., None], 3, axis=3)
    assert phase_spread(coloured) == pytest.approx(phase_spread(pictures), rel=ROUNDING)


def test_phase_spread_of_equal_pictures_is_zero_and_has_no_unit() -> None:
    picture = 1.0 + np.abs(noise())
    assert phase_spread([picture] * 4) == pytest.approx(0.0, abs=ROUNDING)
    phases = np.stack([picture, 1.1 * picture])
    assert phase_spread(7.0 * phases) == pytest.approx(phase_spread(phases), rel=ROUNDING)


@pytest.mark.parametrize(
    ("phases", "mask", "words"),
    [
        (np.ones((1, 4, 4)), None, "K >= 2"),
        (np.ones((4, 4)), None, "K >= 2"),
        (np.zeros((2, 4, 4)), None, "must hold light"),
        (np.full((2, 4, 4), np.nan), None, "NaN"),
        (np.ones((2, 4, 4)), np.zeros((4, 4), dtype=np.bool_), "all false"),
        (np.ones((2, 4, 4)), np.ones((4, 4)), "boolean"),
    ],
)
def test_bad_phases_are_refused(
    phases: NDArray[np.float64], mask: NDArray[np.bool_] | None, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        phase_spread(phases, mask)


def test_bad_residuals_are_refused() -> None:
    with pytest.raises(ValueError, match="one shape"):
        structured_power(np.ones((4, 4, 3)), np.ones((4, 4, 3)))
    with pytest.raises(ValueError, match="NaN"):
        structured_power(np.full((SIZE, SIZE), np.nan), cycles(0.2))
