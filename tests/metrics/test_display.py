from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics import auto_exposure, display_settings, nits_per_unit, srgb_from_linear
from metrics.display import display_nits

Array = NDArray[np.float64]


def test_log_mean_goes_to_middle_grey() -> None:
    reference = np.ones((4, 4, 3))
    reference[:2] = 4.0  # log-mean luminance 2
    assert nits_per_unit(reference) == pytest.approx(9.0)
    assert 2.0 * 2.0 ** auto_exposure(reference) == pytest.approx(0.18)


def test_unlit_pixels_do_not_count(truth: Array) -> None:
    half_black = np.concatenate([truth, np.zeros_like(truth)])
    assert nits_per_unit(half_black) == pytest.approx(nits_per_unit(truth))
    mostly_black = np.zeros((64, 64, 3))
    mostly_black[0, 0] = 2.0
    assert nits_per_unit(mostly_black) == pytest.approx(9.0)


@pytest.mark.parametrize("function", [nits_per_unit, auto_exposure, display_settings])
def test_black_reference_gives_no_display(function: object) -> None:
    assert callable(function)
    with pytest.raises(ValueError, match="reference must hold some light"):
        function(np.zeros((4, 4, 3)))


def test_display_emits_between_nothing_and_its_peak() -> None:
    shown = display_nits(np.array([-1.0, 0.5, 1e6]), 20.0)
    assert shown.tolist() == [0.0, 10.0, 1000.0]


def test_srgb_pictures() -> None:
    image = np.array([[[-1.0, 0.0, 0.001], [0.18, 1.0, 7.0]]])
    encoded = srgb_from_linear(image, 0.0)
    assert encoded[0, 0].tolist() == pytest.approx([0.0, 0.0, 0.01292])
    assert encoded[0, 1].tolist() == pytest.approx([0.461356, 1.0, 1.0], abs=1e-6)
    assert srgb_from_linear(image / 4, 2.0) == pytest.approx(encoded)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_a_display_needs_a_scale(bad: float, truth: Array) -> None:
    with pytest.raises(ValueError, match="nits_per_unit must be finite and above 0"):
        display_nits(truth, bad)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_exposure_is_finite(bad: float, truth: Array) -> None:
    with pytest.raises(ValueError, match="exposure must be a finite number of stops"):
        srgb_from_linear(truth, bad)


def test_image_shape_is_checked() -> None:
    with pytest.raises(ValueError, match=r"image\.shape must be"):
        srgb_from_linear(np.ones((4, 4)), 0.0)
