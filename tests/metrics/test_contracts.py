"""Laws that every metric keeps; a new metric is added to METRICS and is tested by all of them."""

from __future__ import annotations

from collections.abc import Callable
from math import log2

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from metrics import (
    DisplaySettings,
    Measurement,
    delta_e_2000,
    delta_e_itp,
    energy_ratio,
    mean_flip,
    mean_relative_error,
    mse,
    relmse_e001,
    relmse_e2,
    ssim_pq,
)

Array = NDArray[np.float64]

SINGLE_PRECISION = 1e-5
"""FLIP computes in float32 and takes cube roots and powers there."""
IDEAL = 1e-9
"""Float64 sums; the means of equal batches may differ from them by a last bit."""


def shown_at(scale: float) -> DisplaySettings:
    """Show radiance times `scale` as radiance 1 is shown at scale 1."""
    stops = log2(scale)
    return DisplaySettings(
        nits_per_unit=20.0 / scale,
        exposure=-1.5 - stops,
        flip_start_exposure=-3.0 - stops,
        flip_stop_exposure=-0.5 - stops,
        flip_exposure_count=3,
        flip_pixels_per_degree=67.0,
    )


Metric = Callable[[ArrayLike, ArrayLike, DisplaySettings], Measurement]

METRICS: dict[str, Metric] = {
    "energy_ratio": lambda v, r, _: energy_ratio(v, r),
    "mse": lambda v, r, _: mse(v, r),
    "relmse_e2": lambda v, r, _: relmse_e2(v, r),
    "relmse_e001": lambda v, r, _: relmse_e001(v, r),
    "mre": lambda v, r, _: mean_relative_error(v, r),
    "flip": lambda v, r, display: mean_flip(v, r, display.flip),
    "ssim_pq": lambda v, r, display: ssim_pq(v, r, nits_per_unit=display.nits_per_unit),
    "delta_e_itp": lambda v, r, display: delta_e_itp(v, r, nits_per_unit=display.nits_per_unit),
    "delta_e_2000": lambda v, r, display: delta_e_2000(v, r, exposure=display.exposure),
}

DEGREE_IN_RADIANCE = {name: 0 for name in METRICS} | {"mse": 2}
"""How a value grows when test, reference and display are scaled together."""
DEPENDS_ON_EXPOSURE = {"relmse_e001"}
"""Metrics with a constant in units of radiance."""

every_metric = pytest.mark.parametrize("name", METRICS)


@pytest.fixture(scope="module")
def batches(truth: Array) -> Array:
    return truth * np.random.default_rng(2).gamma(100.0, 0.01, size=(5, *truth.shape))


@pytest.fixture(scope="module")
def test_image(truth: Array) -> Array:
    return 1.2 * truth + 0.05


@every_metric
def test_an_image_against_itself_is_ideal(name: str, truth: Array) -> None:
    result = METRICS[name](truth, np.stack([truth] * 5), shown_at(1.0))
    assert result.value == pytest.approx(result.ideal, abs=IDEAL)
    assert result.low == pytest.approx(result.ideal, abs=IDEAL)
    assert result.high == pytest.approx(result.ideal, abs=IDEAL)


@every_metric
def test_a_different_image_is_not_ideal(name: str, test_image: Array, batches: Array) -> None:
    result = METRICS[name](test_image, batches, shown_at(1.0))
    assert result.low is not None
    assert result.high is not None
    assert not result.low <= result.ideal <= result.high
    assert result.low <= result.value <= result.high


@every_metric
def test_a_measurement_names_itself_and_its_formula(
    name: str, test_image: Array, batches: Array
) -> None:
    result = METRICS[name](test_image, batches, shown_at(1.0))
    assert result.name == name
    assert result.component == "image"
    assert "V" in result.formula
    assert "R" in result.formula


@every_metric
def test_scaling_light_and_display_together(name: str, test_image: Array, batches: Array) -> None:
    scale = 8.0
    plain = METRICS[name](test_image, batches, shown_at(1.0)).value
    scaled = METRICS[name](scale * test_image, scale * batches, shown_at(scale)).value
    expected = plain * scale ** DEGREE_IN_RADIANCE[name]
    if name in DEPENDS_ON_EXPOSURE:
        assert scaled != pytest.approx(expected, rel=SINGLE_PRECISION)
    else:
        assert scaled == pytest.approx(expected, rel=SINGLE_PRECISION)


@every_metric
def test_the_order_of_batches_does_not_matter(name: str, test_image: Array, batches: Array) -> None:
    forward = METRICS[name](test_image, batches, shown_at(1.0)).value
    backward = METRICS[name](test_image, batches[::-1], shown_at(1.0)).value
    assert backward == pytest.approx(forward, rel=SINGLE_PRECISION)


@every_metric
def test_float32_and_strided_input_give_the_same(
    name: str, test_image: Array, batches: Array
) -> None:
    expected = METRICS[name](test_image, batches, shown_at(1.0)).value
    wide = np.zeros((5, 16, 32, 4), dtype=np.float32)
    wide[:, :, ::2, :3] = batches
    single = METRICS[name](test_image.astype(np.float32), wide[:, :, ::2, :3], shown_at(1.0))
    assert single.value == pytest.approx(expected, rel=SINGLE_PRECISION)


@every_metric
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_no_number_are_refused(
    name: str, bad: float, test_image: Array, batches: Array
) -> None:
    spoilt = test_image.copy()
    spoilt[3, 4, 1] = bad
    with pytest.raises(ValueError, match=r"test must be finite.*\(3, 4, 1\)"):
        METRICS[name](spoilt, batches, shown_at(1.0))
    spoilt_batches = batches.copy()
    spoilt_batches[2, 3, 4, 1] = bad
    with pytest.raises(ValueError, match=r"batches\[2\] must be finite.*\(3, 4, 1\)"):
        METRICS[name](test_image, spoilt_batches, shown_at(1.0))


@every_metric
@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((16, 15, 3), "must have one shape"),
        ((16, 16, 4), "drop alpha"),
        ((16, 16), r"must be \(H, W, 3\)"),
        ((16, 16, 1), r"must be \(H, W, 3\)"),
        ((0, 16, 3), "it is empty"),
    ],
)
def test_other_shapes_are_refused(
    name: str, shape: tuple[int, ...], message: str, batches: Array
) -> None:
    with pytest.raises(ValueError, match=message):
        METRICS[name](np.ones(shape), batches, shown_at(1.0))


@every_metric
@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((5, 16, 16, 4), "drop alpha"),
        ((16, 16, 3), r"must be \(M, H, W, 3\)"),
        ((1, 16, 16, 3), "independent references, got 1"),
        ((0, 16, 16, 3), "it is empty"),
    ],
)
def test_other_batches_are_refused(
    name: str, shape: tuple[int, ...], message: str, test_image: Array
) -> None:
    with pytest.raises(ValueError, match=message):
        METRICS[name](test_image, np.ones(shape), shown_at(1.0))


@every_metric
def test_numbers_that_are_not_real_are_refused(name: str, batches: Array) -> None:
    with pytest.raises(ValueError, match="real numbers, got dtype complex128"):
        METRICS[name](np.ones((16, 16, 3), dtype=np.complex128), batches, shown_at(1.0))
