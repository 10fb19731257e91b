"""The error of a picture: its formula, its noise, and its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

import metrics
from experiments.optimize.statistics import (
    FrameCost,
    FrameSlopes,
    frame_slopes,
    frame_values,
    slopes_from_json,
)
from experiments.optimize.target import Array, make_target

SHAPE = (6, 5, 3)
COST = FrameCost(samples=3.0, rays=1.0)
ROUNDING = 1e-9


def scene(noise: float, seed: int, count: int = 8) -> tuple[Array, Array]:
    """Return the truth, with a dark corner, and batches of it."""
    rng = np.random.default_rng(seed)
    truth = 0.5 + rng.random(SHAPE)
    truth[:2, :2] = 0.005
    return truth, truth + noise * rng.normal(size=(count, *SHAPE))


def test_without_noise_it_is_the_metric() -> None:
    truth, batches = scene(0.0, 1)
    image = truth * 1.1 + 0.01
    found = make_target(batches).error(image)
    assert found == pytest.approx(metrics.relmse_e2(image, batches).value, rel=ROUNDING)


def test_noise_of_the_reference_shifts_neither_the_error_nor_its_gradient() -> None:
    truth, clean = scene(0.0, 1)
    image = truth + 0.02
    exact = make_target(clean)
    rng = np.random.default_rng(2)
    targets = [make_target(truth + 0.03 * rng.normal(size=(8, *SHAPE))) for _ in range(400)]
    errors = [each.error(image) for each in targets]
    spread = float(np.std(errors)) / np.sqrt(len(errors))
    # Weights of a noisy reference are a little off where it is dark.
    assert np.mean(errors) == pytest.approx(exact.error(image), abs=4.0 * spread, rel=0.02)
    pull = np.mean([each.pull(image) for each in targets], axis=0)
    lit = truth > 0.1
    assert pull[lit].sum() == pytest.approx(exact.pull(image)[lit].sum(), rel=0.02)


def test_limits_are_those_of_the_leak_metric() -> None:
    truth, batches = scene(0.001, 3)
    image = truth * 0.7
    image[:2, :2] += 0.2
    found = make_target(batches).excess(image)
    exact = metrics.one_sided_excess(image, batches)
    # The metric's values are corrected for their bias by the jackknife.
    assert found[0] == pytest.approx(exact["dark_excess"].value, rel=0.02)
    assert found[1] == pytest.approx(exact["missing_energy"].value, rel=0.02)


def linear_slopes(point: Array, columns: Array, truth: Array, batches: Array) -> FrameSlopes:
    image = truth * 0.9 + np.tensordot(point, columns, axes=1)
    costs = np.arange(4.0).reshape(2, 2)
    return frame_slopes(make_target(batches), (image, COST), columns, columns, costs)


def test_slopes_are_those_of_differences() -> None:
    truth, batches = scene(0.01, 4)
    columns = np.random.default_rng(5).normal(size=(2, *SHAPE))
    point, step = np.array([0.1, -0.2]), 1e-6
    centre = linear_slopes(point, columns, truth, batches)
    for number in range(2):
        ends = [point.copy(), point.copy()]
        ends[0][number] -= step
        ends[1][number] += step
        before, after = (linear_slopes(end, columns, truth, batches).values for end in ends)
        for name, found in (
            ("error", centre.gradient),
            ("dark_excess", centre.limited["dark_excess"]),
            ("missing_energy", centre.limited["missing_energy"]),
        ):
            slope = (getattr(after, name) - getattr(before, name)) / (2.0 * step)
            assert found[number] == pytest.approx(slope, rel=1e-4, abs=1e-7), name
    # The error is quadratic in the picture, so the normal matrix is its second derivative.
    shift = np.array([0.03, 0.05])
    moved = linear_slopes(point + shift, columns, truth, batches)
    assert moved.gradient - centre.gradient == pytest.approx(centre.normal @ shift, rel=1e-6)


def test_the_noise_of_the_reference_in_the_gradient_is_what_is_predicted() -> None:
    truth, _ = scene(0.0, 6)
    columns = np.random.default_rng(7).normal(size=(2, *SHAPE))
    rng = np.random.default_rng(8)
    found = [
        linear_slopes(np.zeros(2), columns, truth, truth + 1e-3 * rng.normal(size=(8, *SHAPE)))
        for _ in range(300)
    ]
    measured = np.cov(np.stack([each.gradient for each in found]).T)
    predicted = np.mean([each.reference_noise for each in found], axis=0)
    assert np.diag(predicted) == pytest.approx(np.diag(measured), rel=0.25)


def test_ripple_that_two_frames_do_not_share_is_no_curvature() -> None:
    truth, batches = scene(0.0, 11)
    target, rng = make_target(batches), np.random.default_rng(12)
    trend = np.ones((1, *SHAPE))
    both = frame_slopes(target, (truth, COST), trend, trend, np.zeros((2, 1))).normal[0, 0]
    found = []
    for _ in range(400):
        one, other = (trend + 2.0 * rng.normal(size=trend.shape) for _ in range(2))
        found.append(frame_slopes(target, (truth, COST), one, other, np.zeros((2, 1))).normal[0, 0])
    spread = float(np.std(found)) / np.sqrt(len(found))
    assert np.mean(found) == pytest.approx(both, abs=4.0 * spread)
    assert spread < 0.1 * both


def test_json_holds_slopes_to_the_last_bit() -> None:
    import json

    truth, batches = scene(0.01, 9)
    columns = np.random.default_rng(10).normal(size=(2, *SHAPE))
    found = linear_slopes(np.array([1.0 / 3.0, 0.1]), columns, truth, batches)
    again = slopes_from_json(json.loads(json.dumps(found.to_json())))
    assert again.values == found.values
    assert np.array_equal(again.gradient, found.gradient)
    assert np.array_equal(again.normal, found.normal)
    assert frame_values(make_target(batches), truth, COST).samples == COST.samples


@pytest.mark.parametrize(
    ("batches", "words"),
    [(np.ones((3, *SHAPE)), "at least 4"), (np.zeros((8, *SHAPE)), "black")],
)
def test_what_has_no_relative_error_is_refused(batches: Array, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make_target(batches)
