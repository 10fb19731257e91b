from __future__ import annotations

import numpy as np
import pytest

from metrics import check_finite, require_finite


def test_counts_are_exact() -> None:
    image = np.ones((4, 5, 3))
    image[2, 3, 1] = np.nan
    image[3, 0, 0] = np.inf
    image[3, 1, 0] = -np.inf
    image[0, 0, 0] = -1.0
    check = check_finite(image, "test")
    assert (check.nan_count, check.infinite_count, check.negative_count) == (1, 2, 2)
    assert check.first_bad_index == (2, 3, 1)
    assert not check.is_finite


def test_negative_radiance_is_finite_and_counted() -> None:
    check = require_finite(np.full((2, 2, 3), -1.0), "test")
    assert check.is_finite
    assert check.negative_count == 12
    assert check.first_bad_index is None


def test_refusal_names_image_counts_and_pixel() -> None:
    image = np.ones((4, 5, 3), dtype=np.float32)
    image[1, 2, 0] = np.nan
    with pytest.raises(ValueError, match=r"indirect .* 1 NaN and 0 infinite .* \(1, 2, 0\)"):
        require_finite(image, "indirect")
