"""Front, slope, floor and crossings of errors that are known beforehand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from experiments.studies.check import Measured
from experiments.studies.pareto.trade_off import (
    Errors,
    error_at,
    fit_floor,
    fit_slope,
    pareto_front,
    ratio,
    time_to_reach,
)

SAMPLES: NDArray[np.float64] = np.exp2(np.arange(13.0))
TRIALS = 200
LEAST_COVERAGE = 0.90
"""Of intervals of 95 %: 200 trials scatter by 1.5 %, three times that is allowed."""
FLOAT64_SUM = 1e-9

Points = list[tuple[float, float]]


def measured(value: float, error: float = 0.0) -> Measured:
    """Return a number with a normal interval."""
    return Measured(value=value, low=value - 1.959964 * error, high=value + 1.959964 * error)


def noisy(values: np.ndarray, relative: float, random: np.random.Generator) -> Errors:
    spread = relative * values
    return Errors(
        SAMPLES[: len(values)], values + spread * random.standard_normal(len(values)), spread
    )


@given(st.lists(st.tuples(st.floats(0.1, 9.0), st.floats(0.1, 9.0)), min_size=1, max_size=30))
def test_the_front_is_what_nothing_beats_and_beats_all_else(points: Points) -> None:
    times, errors = zip(*points, strict=True)
    front = pareto_front(times, errors)

    def beats(a: int, b: int) -> bool:
        no_worse = times[a] <= times[b] and errors[a] <= errors[b]
        return bool(no_worse and (times[a] < times[b] or errors[a] < errors[b]))

    assert not any(beats(a, b) for a in range(len(points)) for b in front)
    for other in set(range(len(points))) - set(front):
        is_same = any(points[other] == points[each] for each in front)
        assert is_same or any(beats(each, other) for each in front)
    assert [times[each] for each in front] == sorted(times[each] for each in front)


def test_of_equal_points_one_is_on_the_front() -> None:
    assert pareto_front([1.0, 1.0, 2.0], [3.0, 3.0, 3.0]) == [0]


@pytest.mark.parametrize("exponent", [-1.0, -0.5, -2.0])
def test_a_power_law_has_its_exponent_as_slope(exponent: float) -> None:
    errors = Errors(SAMPLES, 3.0 * SAMPLES**exponent, np.zeros(13))
    assert fit_slope(errors).value == pytest.approx(exponent, abs=FLOAT64_SUM)


def test_intervals_of_a_slope_hold_it() -> None:
    random = np.random.default_rng(1)
    found = [fit_slope(noisy(2.0 / SAMPLES, 0.1, random)) for _ in range(TRIALS)]
    assert np.mean([low(each) <= -1.0 <= high(each) for each in found]) >= LEAST_COVERAGE
    assert np.std([each.value for each in found]) < 0.02


def test_points_that_noise_hides_do_not_bend_a_slope() -> None:
    values = 2.0 / SAMPLES
    values[-3:] = (-1e-3, 4e-3, 1e-5)
    spread = np.where(np.arange(13) < 10, 0.01 * values, 5e-3)
    assert fit_slope(Errors(SAMPLES, values, spread)).value == pytest.approx(-1.0, abs=FLOAT64_SUM)


def test_a_slope_of_two_points_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 3 points"):
        fit_slope(Errors(SAMPLES[:2], 1.0 / SAMPLES[:2], np.zeros(2)))


@pytest.mark.parametrize("floor", [0.02, 0.0])
def test_intervals_of_a_floor_hold_it(floor: float) -> None:
    random = np.random.default_rng(2)
    truth = 0.3 / SAMPLES[:6] + floor
    found = [fit_floor(noisy(truth, 0.05, random)).level for _ in range(TRIALS)]
    assert np.mean([low(each) <= floor <= high(each) for each in found]) >= LEAST_COVERAGE
    # No estimate is kept from going below zero, so their mean is right there, too.
    assert np.mean([each.value for each in found]) == pytest.approx(floor, abs=2e-3)


def test_a_floor_without_noise_is_exact() -> None:
    found = fit_floor(Errors(SAMPLES[:5], 0.3 / SAMPLES[:5] + 0.02, np.zeros(5)))
    assert found.level.value == pytest.approx(0.02, abs=FLOAT64_SUM)
    assert found.slope == pytest.approx(0.3, abs=FLOAT64_SUM)


def test_a_power_law_crosses_where_it_should() -> None:
    # error = 2 / time comes down to 0.03 at 66.7, between the points 64 and 128
    crossing = time_to_reach(Errors(SAMPLES, 2.0 / SAMPLES, np.zeros(13)), measured(0.03))
    assert crossing.reached == "inside"
    assert crossing.time.value == pytest.approx(2.0 / 0.03)
    assert crossing.time.low == pytest.approx(crossing.time.value)


def test_intervals_of_a_crossing_hold_it() -> None:
    random = np.random.default_rng(3)
    hits = 0
    for _ in range(TRIALS):
        target = measured(0.03 * (1.0 + 0.1 * random.standard_normal()), 0.003)
        found = time_to_reach(noisy(2.0 / SAMPLES, 0.05, random), target).time
        hits += low(found) <= 2.0 / 0.03 <= high(found)
    assert hits / TRIALS >= LEAST_COVERAGE


@pytest.mark.parametrize(
    ("target", "reached", "bound"), [(9.0, "before", 1.0), (1e-6, "never", 4096.0)]
)
def test_a_curve_that_does_not_cross_gives_a_bound(
    target: float, reached: str, bound: float
) -> None:
    crossing = time_to_reach(Errors(SAMPLES, 2.0 / SAMPLES, np.zeros(13)), measured(target))
    assert (crossing.reached, crossing.time) == (reached, Measured(value=bound))


def test_a_hidden_error_cannot_be_reached() -> None:
    with pytest.raises(ValueError, match="noise hides it"):
        time_to_reach(Errors(SAMPLES, 2.0 / SAMPLES, np.zeros(13)), measured(-0.1, 1.0))


def test_the_error_at_a_time_is_read_off_the_power_law() -> None:
    errors = Errors(SAMPLES, 2.0 / SAMPLES, 0.1 / SAMPLES)
    found = error_at(errors, 100.0)
    assert found is not None
    assert found.value == pytest.approx(0.02)
    assert low(found) < found.value < high(found)
    assert error_at(errors, 0.5) is None
    assert error_at(errors, 5000.0) is None


def test_a_ratio_has_both_relative_errors() -> None:
    found = ratio(measured(4.0, 0.12), measured(2.0, 0.08))
    # 3 % and 4 % make 5 %
    assert math.log(high(found) / 2.0) == pytest.approx(1.959964 * 0.05)
    assert ratio(Measured(value=4.0), Measured(value=2.0)) == Measured(value=2.0)


def low(found: Measured) -> float:
    assert found.low is not None
    return found.low


def high(found: Measured) -> float:
    assert found.high is not None
    return found.high


def test_places_that_are_not_exact_widen_a_crossing() -> None:
    exact = [Measured(value=float(x)) for x in SAMPLES]
    vague = [measured(float(x), 0.2 * float(x)) for x in SAMPLES]
    errors = [measured(2.0 / float(x)) for x in SAMPLES]
    narrow, wide = (
        time_to_reach(Errors.of(x, errors), measured(0.03)).time for x in (exact, vague)
    )
    assert wide.value == narrow.value
    assert high(wide) - low(wide) > 10.0 > high(narrow) - low(narrow)
