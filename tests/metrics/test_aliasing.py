"""Injection aliasing: ripples, steps and noise of known size, and faults that must be found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics.aliasing import (
    pop_share,
    power_ripple,
    recentring_difference,
    temporal_difference_error,
    temporal_difference_rms,
)
from metrics.energy import energy_ratio
from metrics.measurement import Measurement
from metrics.synthetic import SteadySweep, gaussian_noise, steady_sweep
from metrics.voxel_period import voxel_period_rms, voxel_period_share

PHASES, PERIODS, RECEIVERS, BATCHES = 16, 2, 60, 6
FRAMES = PHASES * PERIODS

ROUNDING = 1e-9
"""Sums of a few thousand float64 values near 1."""

AMPLITUDE = 0.1
NOISE = 0.02
"""Of one batch, relative."""


@dataclass(frozen=True)
class Sweep:
    """A sweep of known light, and noisy references of it."""

    known: SteadySweep

    @property
    def places(self) -> NDArray[np.float64]:
        return self.known.places

    @property
    def truth(self) -> NDArray[np.float64]:
        return self.known.truth

    def batches(self, noise: float = NOISE, seed: int = 0) -> NDArray[np.float64]:
        return self.known.batches(BATCHES, gaussian_noise(noise), seed)

    def rippled(self, amplitude: float = AMPLITUDE, period: float = 1.0) -> NDArray[np.float64]:
        return self.known.rippled(amplitude, period)


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return Sweep(steady_sweep(PHASES, PERIODS, RECEIVERS))


def holds(found: Measurement, expected: float) -> bool:
    assert found.low is not None
    assert found.high is not None
    return found.low - ROUNDING <= expected <= found.high + ROUNDING


def test_power_ripple_is_the_range_over_the_mean() -> None:
    powers = 3.0 + 0.3 * np.sin(2.0 * np.pi * np.arange(16) / 16.0)
    assert power_ripple(powers).value == pytest.approx(0.2, rel=ROUNDING)
    assert power_ripple(powers, expected=powers).value == pytest.approx(0.0, abs=ROUNDING)
    assert power_ripple(7.0 * powers).value == pytest.approx(0.2, rel=ROUNDING)
    assert power_ripple(powers).low is None


def test_noise_of_powers_widens_the_interval_of_the_ripple_but_does_not_leave_it() -> None:
    powers = 3.0 + 0.3 * np.sin(2.0 * np.pi * np.arange(16) / 16.0)
    inside = [
        holds(power_ripple(powers + rng.normal(scale=0.05, size=(8, 16))), 0.2)
        for rng in map(np.random.default_rng, range(100))
    ]
    assert np.mean(inside) > 0.9
    flat = [
        holds(power_ripple(3.0 + rng.normal(scale=0.05, size=(8, 16))), 0.0)
        for rng in map(np.random.default_rng, range(100))
    ]
    assert np.mean(flat) > 0.9


def test_differences_of_a_known_ripple(sweep: Sweep) -> None:
    # A sine that advances by 1/16 of a turn changes by 2 sin(pi/16) of its amplitude; the mean of
    # |sin| is 2/pi, that of its square a half.
    step = 2.0 * np.sin(np.pi / PHASES) * AMPLITUDE
    found = sweep.rippled()
    batches = np.stack([sweep.truth] * BATCHES)
    mean = temporal_difference_error(found, batches).value
    assert mean == pytest.approx(step * 2.0 / np.pi, rel=1e-2)
    rms = temporal_difference_rms(found, batches).value
    assert rms == pytest.approx(step / np.sqrt(2.0), rel=1e-6)


def test_ripple_at_the_voxel_period_is_found_at_its_strength(sweep: Sweep) -> None:
    batches = np.stack([sweep.truth] * BATCHES)
    for period in (1.0, 0.5):
        found = voxel_period_rms(sweep.rippled(period=period), batches, sweep.places)
        assert found.value == pytest.approx(AMPLITUDE / np.sqrt(2.0), rel=ROUNDING)
        share = voxel_period_share(sweep.rippled(period=period), batches, sweep.places)
        assert share.value == pytest.approx(1.0, abs=ROUNDING)


def test_drift_and_waves_of_another_length_are_not_of_the_voxel(sweep: Sweep) -> None:
    batches = np.stack([sweep.truth] * BATCHES)
    drift = sweep.truth * (1.2 + 0.3 * (sweep.places / PERIODS)[:, None, None])
    assert voxel_period_rms(drift, batches, sweep.places).value < 0.02 * AMPLITUDE
    # All energy at another frequency is less at the voxel's than chance would put there.
    other = voxel_period_share(sweep.rippled(period=PERIODS / 3.0), batches, sweep.places)
    assert -0.5 < other.value < 0.0


def test_white_noise_of_frames_has_no_period(sweep: Sweep) -> None:
    batches = np.stack([sweep.truth] * BATCHES)
    found = [
        voxel_period_share(sweep.batches(0.2, seed)[0], batches, sweep.places).value
        for seed in range(10, 18)
    ]
    assert abs(np.mean(found)) < 0.02


@pytest.mark.parametrize(
    "measure",
    [
        temporal_difference_error,
        temporal_difference_rms,
        pop_share,
        lambda v, r: voxel_period_rms(v, r, np.arange(FRAMES) / PHASES),
    ],
)
def test_reference_itself_has_none_within_its_noise(
    sweep: Sweep, measure: Callable[..., Measurement]
) -> None:
    inside = [holds(measure(sweep.truth, sweep.batches(seed=seed)), 0.0) for seed in range(20)]
    assert np.mean(inside) >= 0.85


@pytest.mark.parametrize(
    "measure",
    [
        temporal_difference_error,
        temporal_difference_rms,
        lambda v, r: voxel_period_rms(v, r, np.arange(FRAMES) / PHASES),
        lambda v, r: voxel_period_share(v, r, np.arange(FRAMES) / PHASES),
    ],
)
def test_noise_of_the_reference_stays_within_the_interval(
    sweep: Sweep, measure: Callable[..., Measurement]
) -> None:
    found = sweep.rippled()
    exact = measure(found, np.stack([sweep.truth] * BATCHES)).value
    inside = [holds(measure(found, sweep.batches(seed=seed)), exact) for seed in range(20)]
    assert np.mean(inside) >= 0.85


def test_measures_grow_with_their_cause(sweep: Sweep) -> None:
    batches = sweep.batches()
    for measure in (temporal_difference_error, temporal_difference_rms):
        values = [measure(sweep.rippled(a), batches).value for a in (0.0, 0.05, 0.1, 0.2)]
        assert values == sorted(values)
    values = [
        voxel_period_rms(sweep.rippled(a), batches, sweep.places).value for a in (0.0, 0.05, 0.1)
    ]
    assert values == sorted(values)


def test_pops_are_counted() -> None:
    truth = np.ones((10, 100, 3))
    popped = truth.copy()
    popped[5:, :7] *= 1.2
    found = pop_share(popped, np.stack([truth] * 4))
    assert found.value == pytest.approx(7 / 900, rel=ROUNDING)
    # A step too small to be seen is none
    small = truth.copy()
    small[5:, :7] *= 1.005
    assert pop_share(small, np.stack([truth] * 4)).value == 0.0


def test_planted_faults_are_found(sweep: Sweep) -> None:
    batches = sweep.batches()
    step = sweep.truth.copy()
    step[FRAMES // 2 :] *= 1.1
    still = temporal_difference_error(sweep.truth, batches)
    stepped = temporal_difference_rms(step, batches)
    assert still.low is not None
    assert stepped.low is not None
    assert stepped.low > 0.01
    assert pop_share(step, batches).value > 0.5 / (FRAMES - 1)
    brighter = energy_ratio(1.05 * sweep.truth, batches)
    assert brighter.low is not None
    assert brighter.low > 1.04
    broken = sweep.truth.copy()
    broken[3, 4, 1] = np.nan
    for measure in (temporal_difference_error, temporal_difference_rms, pop_share):
        with pytest.raises(ValueError, match="NaN"):
            measure(broken, batches)
    with pytest.raises(ValueError, match="NaN"):
        voxel_period_rms(broken, batches, sweep.places)


def test_recentring_is_the_largest_difference() -> None:
    image = np.ones((4, 1, 3))
    other = image.copy()
    other[2, 0, 1] = 1.5
    assert recentring_difference(2.0 * image, 2.0 * other) == pytest.approx(0.5, rel=ROUNDING)
    assert recentring_difference(image, image) == 0.0
    with pytest.raises(ValueError, match="one shape"):
        recentring_difference(image, image[:2])
    with pytest.raises(ValueError, match="must hold light"):
        recentring_difference(0.0 * image, image)


@pytest.mark.parametrize(
    ("powers", "expected", "words"),
    [
        ([1.0], None, "K >= 2"),
        ([[1.0, 2.0]], None, "M >= 2"),
        ([1.0, np.nan], None, "NaN"),
        ([0.0, 0.0], None, "dark"),
        ([1.0, 2.0], [1.0, 0.0], "above zero"),
        ([1.0, 2.0], [1.0], "expected must be"),
    ],
)
def test_bad_powers_are_refused(
    powers: list[float], expected: list[float] | None, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        power_ripple(powers, expected)


def test_bad_sweeps_are_refused(sweep: Sweep) -> None:
    batches = sweep.batches()
    with pytest.raises(ValueError, match="at least 2 frames"):
        temporal_difference_error(sweep.truth[:1], batches[:, :1])
    with pytest.raises(ValueError, match="hold light"):
        temporal_difference_rms(sweep.truth, 0.0 * batches)
    with pytest.raises(ValueError, match="at least 3 independent"):
        temporal_difference_rms(sweep.truth, batches[:2])
    with pytest.raises(ValueError, match="one shape"):
        pop_share(sweep.truth[1:], batches)
    with pytest.raises(ValueError, match="must cross 2 voxels"):
        voxel_period_rms(sweep.truth, batches, 0.5 * sweep.places)
    with pytest.raises(ValueError, match="one for each frame"):
        voxel_period_rms(sweep.truth, batches, sweep.places[1:])
    with pytest.raises(ValueError, match="eighth of a voxel"):
        voxel_period_rms(sweep.truth[:8], batches[:, :8], np.arange(8) / 2.0)
