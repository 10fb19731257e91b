"""Bands that move with the start phase, found where they are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics.moving_bands import LEAST_PHASES, MovingBands, moving_bands, ratio_of_bands
from metrics.synthetic import march_cycles

SIZE = 64

PHASES = np.arange(8) * 17.0 / 128.0
"""Not quite even, as the noise of 16 phases asks."""

ROUNDING = 1e-9
"""Sums of a few thousand float64 values near 1."""

STRENGTH = 0.1
MEAN = 2.0
BAND_POWER = 0.5 * (STRENGTH / MEAN) ** 2
"""Mean square of a sine of this strength, relative to the light."""

STRAY = 0.1
"""Share of a band's power that neighbours may agree on by chance, or because they are close."""

CHANCE = 4.0
"""Standard errors by which a number may differ from its expectation."""


def cycles(per_pixel: float = 0.2, degrees: float = 30.0) -> NDArray[np.float64]:
    return march_cycles(SIZE, per_pixel, degrees)


def banded(strength: float = STRENGTH, harmonic: int = 1, sign: float = 1.0) -> NDArray[np.float64]:
    """Pictures at all phases: bands that depend on cycles + phase."""
    place = cycles() + sign * PHASES[:, None, None]
    found: NDArray[np.float64] = MEAN + strength * np.sin(2.0 * np.pi * harmonic * place + 0.7)
    return found


def noise(deviation: float, seed: int = 1) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(scale=deviation, size=(len(PHASES), SIZE, SIZE))


def found_in(pictures: NDArray[np.float64]) -> MovingBands:
    return moving_bands(pictures, PHASES, cycles())


@pytest.mark.parametrize("harmonic", [1, 2])
def test_bands_have_their_power(harmonic: int) -> None:
    # A tile's own mean brightness differs from the picture's by what of a band it holds.
    assert found_in(banded(harmonic=harmonic)).power.value == pytest.approx(BAND_POWER, rel=1e-2)


def test_spread_is_the_variance_over_phases() -> None:
    found = found_in(banded())
    expected = banded().var(axis=0, ddof=1).mean() / MEAN**2
    assert found.spread.value == pytest.approx(expected, rel=1e-2)


def test_power_grows_as_the_square() -> None:
    first, second = (found_in(banded(k * STRENGTH)) for k in (0.1, 0.3))
    assert ratio_of_bands(second.tile_powers, first.tile_powers).value == pytest.approx(9.0, 1e-2)


def test_what_stands_still_does_not_count_even_on_the_waves_of_the_bands() -> None:
    # The error of the method that a residual against the truth takes for bands.
    error = 5.0 * STRENGTH * np.sin(2.0 * np.pi * cycles())
    still, moving = found_in(banded(0.0) + error), found_in(banded() + error)
    assert still.power.value == pytest.approx(0.0, abs=ROUNDING)
    assert moving.power.value == pytest.approx(found_in(banded()).power.value, rel=1e-2)


def test_what_moves_the_other_way_or_all_at_once_is_no_band() -> None:
    pulse = MEAN + STRENGTH * np.sin(2.0 * np.pi * PHASES)[:, None, None] * np.ones((SIZE, SIZE))
    for other in (banded(sign=-1.0), pulse):
        found = found_in(other)
        assert found.power.value < STRAY * BAND_POWER
        assert found.spread.value > 0.9 * BAND_POWER


def test_noise_has_no_bands_and_moves_none() -> None:
    deviation = 3.0 * STRENGTH
    alone = [found_in(banded(0.0) + noise(deviation, seed)).power for seed in range(12)]
    values = np.array([each.value for each in alone])
    assert abs(values.mean()) < CHANCE * values.std(ddof=1) / np.sqrt(len(values))
    both = found_in(banded() + noise(deviation)).power
    assert both.low < BAND_POWER < both.high


def test_intervals_hold_the_truth() -> None:
    inside = 0
    for seed in range(100):
        power = found_in(banded() + noise(2.0 * STRENGTH, seed)).power
        inside += power.low <= BAND_POWER <= power.high
    # 95 of 100 nominally, less four standard deviations of a binomial.
    assert inside >= 86


def test_light_of_any_unit_has_the_same_bands() -> None:
    first, second = found_in(banded()), found_in(1.05 * banded())
    assert second.power.value == pytest.approx(first.power.value, rel=ROUNDING)


def test_a_random_start_of_every_pixel_leaves_no_bands_but_all_of_the_spread() -> None:
    jitter = np.random.default_rng(3).uniform(size=(SIZE, SIZE))
    place = cycles() + jitter + PHASES[:, None, None]
    found = found_in(MEAN + STRENGTH * np.sin(2.0 * np.pi * place))
    assert abs(found.power.value) < STRAY * BAND_POWER
    assert found.spread.value > 0.9 * BAND_POWER


def test_a_wrong_number_of_steps_loses_little_of_a_band() -> None:
    # Half a cycle of error over a tile.
    y = np.mgrid[0:SIZE, 0:SIZE][0]
    found = moving_bands(banded(), PHASES, cycles() + 0.03 * y)
    assert found.power.value == pytest.approx(BAND_POWER, rel=0.1)


def test_what_the_mask_leaves_out_does_not_count() -> None:
    mask = np.zeros((SIZE, SIZE), dtype=np.bool_)
    mask[:, :32] = True
    found = moving_bands(np.where(mask, banded(), np.nan), PHASES, cycles(), mask)
    assert found.power.value == pytest.approx(BAND_POWER, rel=1e-2)
    assert len(found.tile_powers) == 8


def test_bad_pictures_are_refused() -> None:
    one_nan = banded()
    one_nan[2, 5, 5] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        found_in(one_nan)
    with pytest.raises(ValueError, match="pass luminance"):
        moving_bands(np.ones((8, 4, 4, 3)), PHASES, np.ones((4, 4)))
    few = LEAST_PHASES - 1
    with pytest.raises(ValueError, match="different phases"):
        moving_bands(banded()[:few], PHASES[:few], cycles())
    with pytest.raises(ValueError, match="only 0 tiles"):
        moving_bands(banded(), PHASES, 0.01 * cycles())
    with pytest.raises(ValueError, match="must hold light"):
        found_in(np.zeros((8, SIZE, SIZE)))
    with pytest.raises(ValueError, match="boolean"):
        moving_bands(banded(), PHASES, cycles(), np.ones((SIZE, SIZE)))
    with pytest.raises(ValueError, match="same two tiles"):
        ratio_of_bands(np.ones(3), np.ones(2))
