from __future__ import annotations

from dataclasses import replace

import flip_evaluator
import numpy as np
import pytest
from numpy.typing import NDArray

from metrics import FlipSettings, flip, flip_exposures, mean_flip

Array = NDArray[np.float64]

SETTINGS = FlipSettings(
    start_exposure=-3.0, stop_exposure=0.0, exposure_count=3, pixels_per_degree=67.0
)


def test_an_image_does_not_differ_from_itself(truth: Array) -> None:
    result = flip(truth, truth, SETTINGS)
    assert result.mean == 0.0
    assert result.error_map.shape == truth.shape[:2]
    assert not result.error_map.any()


def test_map_and_mean_agree_and_are_shares(truth: Array) -> None:
    result = flip(1.5 * truth, truth, SETTINGS)
    assert result.mean == pytest.approx(float(result.error_map.mean()), rel=1e-5)
    assert 0.0 < result.error_map.min() <= result.error_map.max() <= 1.0


def test_error_stays_where_it_is_made(truth: Array) -> None:
    large = np.tile(truth, (4, 4, 1))
    spoilt = large.copy()
    spoilt[8, 40] *= 10.0
    error_map = flip(spoilt, large, SETTINGS).error_map
    assert error_map.argmax() == 8 * error_map.shape[1] + 40
    assert error_map[40:, :16].max() < 1e-3


def test_exposures_are_those_of_flip_where_every_pixel_is_lit(truth: Array) -> None:
    # An odd number of pixels, because FLIP takes the upper one of two medians
    lit = (truth[:15, :15] + 0.5).astype(np.float32)
    _, _, used = flip_evaluator.evaluate(lit, lit, "HDR", applyMagma=False)
    start, stop, count = flip_exposures(lit)
    assert start == pytest.approx(used["startExposure"], abs=1e-4)
    assert stop == pytest.approx(used["stopExposure"], abs=1e-4)
    assert count == used["numExposures"]


def test_unlit_pixels_do_not_lift_the_exposures(truth: Array) -> None:
    mostly_black = np.concatenate([truth, np.zeros_like(truth), np.zeros_like(truth)])
    assert flip_exposures(mostly_black) == pytest.approx(flip_exposures(truth))


def test_flat_reference_has_two_exposures() -> None:
    start, stop, count = flip_exposures(np.ones((4, 4, 3)))
    assert start == stop
    assert count == 2
    settings = replace(SETTINGS, start_exposure=start, stop_exposure=stop, exposure_count=count)
    assert flip(np.full((4, 4, 3), 0.5), np.ones((4, 4, 3)), settings).mean > 0


def test_black_reference_gives_no_exposures() -> None:
    with pytest.raises(ValueError, match="reference must hold some light"):
        flip_exposures(np.zeros((4, 4, 3)))


def test_black_reference_is_safe_with_pinned_exposures(truth: Array) -> None:
    assert flip(np.zeros_like(truth), np.zeros_like(truth), SETTINGS).mean == 0.0
    assert flip(truth, np.zeros_like(truth), SETTINGS).mean > 0.5


def test_negative_light_is_black(truth: Array) -> None:
    negative = np.full_like(truth, -1.0)
    assert flip(negative, truth, SETTINGS).mean == flip(0.0 * truth, truth, SETTINGS).mean


def test_memory_order_and_precision_do_not_matter(truth: Array) -> None:
    test = 1.2 * truth
    expected = flip(test, truth, SETTINGS).mean
    assert flip(np.asfortranarray(test), np.asfortranarray(truth), SETTINGS).mean == expected
    assert flip(test.astype(np.float32), truth, SETTINGS).mean == expected
    with_alpha = np.ones((16, 16, 4))
    with_alpha[..., :3] = test
    assert flip(with_alpha[..., :3], truth, SETTINGS).mean == expected


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_and_infinity_are_refused(truth: Array, bad: float) -> None:
    spoilt = truth.copy()
    spoilt[0, 1, 2] = bad
    with pytest.raises(ValueError, match=r"test must be finite.*\(0, 1, 2\)"):
        flip(spoilt, truth, SETTINGS)
    with pytest.raises(ValueError, match=r"reference must be finite.*\(0, 1, 2\)"):
        flip(truth, spoilt, SETTINGS)


def test_light_beyond_single_precision_is_refused(truth: Array) -> None:
    with pytest.raises(ValueError, match="32-bit floats"):
        flip(truth * 1e39, truth, SETTINGS)


@pytest.mark.parametrize(
    ("shape", "message"),
    [((16, 16, 4), "drop alpha"), ((16, 16), "must be"), ((8, 16, 3), "one shape")],
)
def test_other_shapes_are_refused(truth: Array, shape: tuple[int, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        flip(np.ones(shape), truth, SETTINGS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exposure_count": 1}, "exposure_count must be at least 2, got 1"),
        ({"stop_exposure": -4.0}, "stop_exposure must be at least start_exposure"),
        ({"start_exposure": float("nan")}, "must be finite"),
        ({"stop_exposure": float("inf")}, "must be finite"),
        ({"pixels_per_degree": 0.0}, "pixels_per_degree must be finite and above 0"),
        ({"pixels_per_degree": float("nan")}, "pixels_per_degree must be finite and above 0"),
    ],
)
def test_settings_that_end_or_fool_the_evaluator_are_refused(
    change: dict[str, float], message: str
) -> None:
    values = {
        "start_exposure": -3.0,
        "stop_exposure": 0.0,
        "exposure_count": 3,
        "pixels_per_degree": 67.0,
    }
    with pytest.raises(ValueError, match=message):
        FlipSettings(**(values | change))  # type: ignore[arg-type]


def test_large_image_has_a_value_without_interval(truth: Array) -> None:
    batches = np.stack([truth] * 4)
    large = mean_flip(1.2 * truth, batches, SETTINGS, interval_pixel_limit=255)
    assert (large.low, large.high) == (None, None)
    assert "no interval above 255 pixels" in large.note
    small = mean_flip(1.2 * truth, batches, SETTINGS, interval_pixel_limit=256)
    assert small.low is not None
    assert small.value == pytest.approx(large.value, rel=1e-5)
    assert "3 exposures from -3.000 to 0.000 stops" in large.formula
