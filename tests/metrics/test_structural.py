from __future__ import annotations

import colour.models
import numpy as np
import pytest

from metrics import pq_from_nits, ssim_pq

SSIM_C1 = 0.01**2
"""(K1 data_range)^2 of the SSIM paper."""


def test_pq_of_100_nits() -> None:
    assert pq_from_nits(np.array(100.0)) == pytest.approx(0.508078421517, abs=1e-12)


def test_pq_equals_an_independent_implementation() -> None:
    nits = np.geomspace(1e-4, 1e4, 50)
    assert pq_from_nits(nits) == pytest.approx(colour.models.eotf_inverse_ST2084(nits), abs=1e-12)
    assert pq_from_nits(np.array(10000.0)) == pytest.approx(1.0, abs=1e-12)


def test_ssim_of_two_flat_images_compares_their_codes_alone() -> None:
    test, reference = np.full((16, 16, 3), 0.5), np.ones((4, 16, 16, 3))
    first, second = pq_from_nits(np.array([50.0, 100.0]))
    expected = (2 * first * second + SSIM_C1) / (first**2 + second**2 + SSIM_C1)
    assert ssim_pq(test, reference, nits_per_unit=100.0).value == pytest.approx(expected, abs=1e-9)


def test_above_the_peak_everything_looks_alike() -> None:
    test, reference = np.full((16, 16, 3), 20.0), np.full((4, 16, 16, 3), 50.0)
    assert ssim_pq(test, reference, nits_per_unit=100.0).value == pytest.approx(1.0)


@pytest.mark.parametrize("shape", [(10, 64, 3), (64, 10, 3)])
def test_image_smaller_than_the_window_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="at least 11 x 11 pixels"):
        ssim_pq(np.ones(shape), np.ones((2, *shape)), nits_per_unit=1.0)


def test_smallest_image_is_accepted() -> None:
    assert ssim_pq(np.ones((11, 11, 3)), np.ones((2, 11, 11, 3)), nits_per_unit=1.0).value == 1.0
