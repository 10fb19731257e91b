from __future__ import annotations

from math import isfinite
from time import process_time

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics import display_settings, measure

Array = NDArray[np.float64]

ABSOLUTE = ["mse", "flip", "ssim_pq", "delta_e_itp", "delta_e_2000"]
LEAKING = ["dark_excess", "missing_energy"]
RELATIVE = ["energy_ratio", "relmse_e2", "relmse_e001", "mre", *LEAKING]

SECONDS_OF_256 = 6.0
"""Processor time for 256 x 256 and 8 batches: 0.9 s measured, the rest for slower machines."""


@pytest.fixture
def batches(truth: Array) -> Array:
    return truth * np.random.default_rng(2).gamma(100.0, 0.01, size=(5, *truth.shape))


def test_every_metric_in_order(truth: Array, batches: Array) -> None:
    results = measure(
        1.1 * truth, batches, component="indirect", display=display_settings(batches.mean(axis=0))
    )
    assert [result.name for result in results] == RELATIVE + ABSOLUTE
    for result in results:
        assert result.component == "indirect"
        assert result.note == ""
        assert result.low is not None
        assert result.high is not None
        assert isfinite(result.low)
        assert result.low <= result.value <= result.high


def test_black_component_keeps_its_absolute_metrics(truth: Array, batches: Array) -> None:
    results = measure(
        np.full_like(truth, 0.1),
        np.zeros_like(batches),
        component="indirect_specular",
        display=display_settings(truth),
    )
    assert [result.name for result in results] == ABSOLUTE
    for result in results:
        assert isfinite(result.value)
        assert result.value != result.ideal
        assert "5 of 5 reference batches are black" in result.note
    assert results[0].value == pytest.approx(0.01)


def test_black_against_black_is_ideal(truth: Array, batches: Array) -> None:
    results = measure(
        np.zeros_like(truth),
        np.zeros_like(batches),
        component="indirect_specular",
        display=display_settings(truth),
    )
    assert [result.value for result in results] == [result.ideal for result in results]


def test_one_black_batch_is_enough_to_leave_ratios_out(truth: Array, batches: Array) -> None:
    batches[3] = 0.0
    results = measure(truth, batches, component="image", display=display_settings(truth))
    assert [result.name for result in results] == ABSOLUTE
    assert "1 of 5 reference batches are black" in results[0].note


def test_negative_light_is_told(truth: Array, batches: Array) -> None:
    test = truth.copy()
    test[0, 0] = -0.1
    results = measure(test, batches, component="image", display=display_settings(truth))
    assert all("3 negative values in the test" in result.note for result in results)


def test_nan_is_refused_before_anything_else(truth: Array, batches: Array) -> None:
    batches[1, 0, 0, 0] = np.nan
    with pytest.raises(ValueError, match=r"batches\[1\] must be finite"):
        measure(truth, batches, component="image", display=display_settings(truth))


def test_too_few_batches_are_refused(truth: Array, batches: Array) -> None:
    with pytest.raises(ValueError, match="at least 4 independent references, got 3"):
        measure(truth, batches[:3], component="image", display=display_settings(truth))


def test_a_report_image_is_measured_in_seconds(truth: Array) -> None:
    large = np.kron(truth, np.ones((16, 16, 1)))
    batches = large * np.random.default_rng(2).gamma(100.0, 0.01, size=(8, *large.shape))
    display = display_settings(large)
    measure(truth, batches[:, :16, :16], component="image", display=display)  # slow imports
    start = process_time()
    measure(1.1 * large, batches, component="image", display=display)
    assert process_time() - start < SECONDS_OF_256
