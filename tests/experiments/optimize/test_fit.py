"""The objective of a fit over scenes whose errors are parabolas, and its limits."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.optimize.adam import AdamOptions, minimise_by_adam
from experiments.optimize.fit import Fit, LimitRules
from experiments.optimize.gauss_newton import StopRule, minimise
from experiments.optimize.statistics import FrameSlopes, FrameValues
from experiments.optimize.target import Array

LOW, HIGH = np.full(2, -3.0), np.full(2, 3.0)
NO_LIMITS = LimitRules(has_leaks=False, has_cost=False)
NOISE = 0.7
"""What the reference's noise takes off each error."""


class Parabolas:
    """Scenes whose error is the squared distance from a place that each frame moves a little.

    Samples grow with the first number, and leaking with the second.
    """

    def __init__(self, places: Array, sizes: tuple[float, ...], frame_count: int = 4) -> None:
        rng = np.random.default_rng(1)
        self.places = places[:, None] + 0.05 * rng.normal(size=(len(places), frame_count, 2))
        self.sizes = sizes
        self.frame_count = frame_count
        self.asked = 0

    @property
    def scene_count(self) -> int:
        return len(self.sizes)

    def values(self, scene: int, frame: int, point: Array) -> FrameValues:
        self.asked += 1
        squares = self.sizes[scene] * float(np.sum((point - self.places[scene, frame]) ** 2))
        squares += self.sizes[scene] * NOISE
        return FrameValues(
            error=squares - self.sizes[scene] * NOISE,
            squares=squares,
            dark_excess=0.1 * (4.0 + point[1]),
            missing_energy=0.1,
            samples=10.0 * (4.0 + point[0]),
            rays=1.0,
        )

    def slopes(self, scene: int, frame: int, point: Array) -> FrameSlopes:
        away = point - self.places[scene, frame]
        return FrameSlopes(
            values=self.values(scene, frame, point),
            gradient=2.0 * self.sizes[scene] * away,
            normal=2.0 * self.sizes[scene] * np.eye(2),
            reference_noise=np.zeros((2, 2)),
            limited={
                "dark_excess": np.array([0.0, 0.1]),
                "missing_energy": np.zeros(2),
                "work": np.array([10.0, 0.0]),
            },
        )


PLACES = np.array([[1.0, 0.5], [1.0, 0.5]])


def test_it_begins_at_one_and_a_large_scene_counts_as_much_as_a_small_one() -> None:
    scenes = Parabolas(np.array([[1.0, 0.0], [-1.0, 0.0]]), (1.0, 1e-4))
    start = np.zeros(2)
    fit = Fit(scenes, start, NO_LIMITS)
    assert fit.objective(fit.frames(start)) == pytest.approx(1.0)
    found = minimise(fit, start, LOW, HIGH)
    # The middle of both, but for the frames' scatter.
    assert found.point == pytest.approx(np.zeros(2), abs=0.1)


def test_both_optimisers_find_the_same_place() -> None:
    fit = Fit(Parabolas(PLACES, (1.0, 2.0)), np.zeros(2), NO_LIMITS)
    exact = minimise(fit, np.zeros(2), LOW, HIGH).point
    assert exact == pytest.approx(PLACES[0], abs=0.1)
    many = AdamOptions(iterations=300, rate=0.05)
    assert minimise_by_adam(fit, np.zeros(2), LOW, HIGH, many).point == pytest.approx(
        exact, abs=0.03
    )


def test_the_model_is_the_value_with_its_derivatives() -> None:
    fit = Fit(Parabolas(PLACES, (1.0, 2.0)), np.zeros(2))
    point, step = np.array([0.05, 0.05]), 1e-6
    model = fit.model(point)
    assert model.value == pytest.approx(fit.value(point))
    for number in range(2):
        ends = [point.copy(), point.copy()]
        ends[0][number] -= step
        ends[1][number] += step
        slope = (fit.value(ends[1]) - fit.value(ends[0])) / (2.0 * step)
        assert model.gradient[number] == pytest.approx(slope, rel=1e-5)
    groups = np.mean([fit.group_gradient(point, each) for each in range(4)], axis=0)
    assert groups == pytest.approx(model.gradient)


def test_no_result_breaks_a_limit_but_it_goes_as_far_as_it_may() -> None:
    start = np.zeros(2)
    fit = Fit(Parabolas(PLACES, (1.0, 2.0)), start)
    found = minimise(fit, start, LOW, HIGH, StopRule(evaluations=60))
    frames = fit.frames(found.point)
    assert not fit.broken_limits(frames)
    # 2 % of 40 samples and of 0.4 of leaking are allowed.
    assert 0.001 <= found.point[0] <= 0.08
    assert 0.001 <= found.point[1] <= 0.08


def test_intervals_hold_the_mean_of_the_frames_places() -> None:
    scenes = Parabolas(PLACES, (1.0, 2.0), frame_count=12)
    fit = Fit(scenes, np.zeros(2), NO_LIMITS)
    found = minimise(fit, np.zeros(2), LOW, HIGH, StopRule(tolerance=1e-10))
    sure = fit.uncertainty(found.point, LOW, HIGH)
    assert sure.is_identified.all()
    # Two scenes of 12 frames, 0.05 of scatter each: a standard error of about 0.01.
    assert sure.half_widths == pytest.approx(np.full(2, 2.07 * 0.05 / np.sqrt(24.0)), rel=0.4)
    assert np.all(np.abs(found.point - PLACES[0]) < 2.0 * sure.half_widths)


def test_what_costs_far_too_much_is_refused_after_one_frame() -> None:
    scenes = Parabolas(PLACES, (1.0, 1.0))
    fit = Fit(scenes, np.zeros(2))
    scenes.asked = 0
    # Half as many samples again.
    assert fit.value(np.array([2.0, 0.0])) == np.inf
    assert scenes.asked == 1
    # A tenth more is beyond the limit too, but only the mean over frames says so.
    scenes.asked = 0
    assert fit.value(np.array([0.4, 0.0])) == np.inf
    assert scenes.asked > len(PLACES) * scenes.frame_count


def test_a_search_is_refused_but_not_pushed() -> None:
    scenes = Parabolas(PLACES, (1.0, 1.0))
    search = Fit(scenes, np.zeros(2), is_pushed=False)
    # Leaking grows with the second number; its allowance is 2 % of 0.4.
    slightly, far = np.array([0.0, 0.05]), np.array([0.0, 0.5])
    frames = search.frames(slightly)
    squares = np.mean(
        [
            each.squares / error
            for rows, error in zip(frames, search.start_errors, strict=True)
            for each in rows
        ]
    )
    assert search.value(slightly) == pytest.approx(float(squares))
    assert Fit(scenes, np.zeros(2)).value(slightly) > search.value(slightly)
    assert search.value(far) == np.inf
