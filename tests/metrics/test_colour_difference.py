from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics import delta_e_2000, delta_e_itp, pq_from_nits

Array = NDArray[np.float64]

LMS_FROM_BT2020 = np.array([[1688, 2146, 262], [683, 2951, 462], [99, 309, 3688]]) / 4096
ICTCP_FROM_LMS = np.array([[2048, 2048, 0], [6610, -13613, 7003], [17933, -17390, -543]]) / 4096
BT2020_FROM_BT709 = np.array(
    [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
)
"""Rec. ITU-R BT.2100 and BT.2087."""


def ictcp(nits: Array) -> Array:
    """BT.2100 by hand."""
    return np.asarray(pq_from_nits(nits @ (LMS_FROM_BT2020 @ BT2020_FROM_BT709).T)) @ (
        ICTCP_FROM_LMS.T
    )


def test_two_greys_differ_by_their_codes() -> None:
    test, reference = np.full((4, 4, 3), 0.5), np.ones((4, 4, 4, 3))
    low, high = pq_from_nits(np.array([50.0, 100.0]))
    result = delta_e_itp(test, reference, nits_per_unit=100.0)
    assert result.value == pytest.approx(720 * (high - low), rel=1e-9)


def test_colours_differ_as_bt2124_says(truth: Array) -> None:
    test = truth[:, :, ::-1]
    difference = (ictcp(20.0 * test) - ictcp(20.0 * truth)) * [1.0, 0.5, 1.0]
    expected = 720 * np.sqrt((difference**2).sum(axis=-1)).mean()
    result = delta_e_itp(test, np.stack([truth] * 5), nits_per_unit=20.0)
    assert result.value == pytest.approx(expected, rel=1e-9)


def test_the_inputs_are_left_alone(truth: Array) -> None:
    test, batches = 1.1 * truth, np.stack([truth] * 4)
    before, batches_before = test.copy(), batches.copy()
    delta_e_itp(test, batches, nits_per_unit=20.0)
    delta_e_2000(test, batches, exposure=0.0)
    assert (test == before).all()
    assert (batches == batches_before).all()


def test_black_and_white_are_a_hundred_apart() -> None:
    result = delta_e_2000(np.zeros((4, 4, 3)), np.ones((4, 4, 4, 3)), exposure=0.0)
    # The rounded sRGB matrix leaves white a trace of colour.
    assert result.value == pytest.approx(100.0, abs=0.01)


def test_clipped_light_is_not_compared() -> None:
    result = delta_e_2000(np.full((4, 4, 3), 2.0), np.full((4, 4, 4, 3), 5.0), exposure=0.0)
    assert result.value == pytest.approx(0.0, abs=1e-9)
    seen = delta_e_2000(np.full((4, 4, 3), 2.0), np.full((4, 4, 4, 3), 5.0), exposure=-3.0)
    assert seen.value > 10
