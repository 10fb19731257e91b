"""B3: two flats of known codes have a known index; smooth bands and noise have none."""

from __future__ import annotations

import numpy as np
import pytest

from metrics.display_banding import (
    SCALE_WEIGHTS,
    WINDOW,
    _contrasts,
    banding_index,
    display_banding,
    display_banding_excess,
    display_codes,
)

EDGE = 128

ROUNDING = 1e-9
"""Of running sums over a window."""


def halves(difference: int) -> np.ndarray:
    """Two flats, left and right, that differ by so many codes."""
    return np.where(np.arange(EDGE) < EDGE // 2, 500, 500 + difference) * np.ones((EDGE, 1), int)


@pytest.mark.parametrize(("difference", "weight"), [(1, 1.0), (2, 2.0), (4, 4.0), (5, 0.0)])
def test_contrast_at_the_border_of_two_flats(difference: int, weight: float) -> None:
    # At the last pixel on the left the window holds 32 columns of its own side and 31 of the other.
    own, beside = 32 / WINDOW, 31 / WINDOW
    found = _contrasts(halves(difference))[EDGE // 2, EDGE // 2 - 1]
    assert found == pytest.approx(weight * own * beside / (own + beside), abs=ROUNDING)


def test_flats_without_a_neighbour_have_none() -> None:
    assert banding_index(np.full((EDGE, EDGE), 321)) == 0.0
    assert banding_index(halves(30)) == 0.0


def test_index_grows_with_the_step_of_the_codes() -> None:
    values = [banding_index(halves(step)) for step in (1, 2, 3, 4)]
    assert values[0] > 0.0
    assert values == pytest.approx([values[0] * k for k in (1, 2, 3, 4)], rel=ROUNDING)
    # Nothing of a picture exceeds half a contrast of the largest weight at every scale.
    assert values[-1] < 0.5 * 4.0 * sum(SCALE_WEIGHTS)


def test_slopes_and_noise_leave_no_flat() -> None:
    slope = np.arange(EDGE)[None, :] + np.zeros((EDGE, 1), int)
    noise = np.random.default_rng(1).integers(400, 420, (EDGE, EDGE))
    assert banding_index(slope) == banding_index(noise) == 0.0


def test_it_is_blind_to_strong_smooth_bands() -> None:
    """What a march makes has no flats; that is why this is a cross-check and no more."""
    column = np.arange(EDGE)
    smooth = 1.0 + 0.3 * np.sin(2.0 * np.pi * column / 12.0)
    weak_flats = np.where(column // 16 % 2, 1.0, 1.01)
    pictures = [
        np.broadcast_to(row[None, :, None], (EDGE, EDGE, 3)) for row in (smooth, weak_flats)
    ]
    indices = [display_banding(picture, nits_per_unit=20.0) for picture in pictures]
    assert indices[0] < 0.1 * indices[1]


def test_codes_are_ten_bits_of_pq() -> None:
    # SMPTE ST 2084: 100 cd/m^2 has the code 0.5081.
    grey = np.full((2, 2, 3), 100.0)
    assert (display_codes(grey, nits_per_unit=1.0) == round(0.5081 * 1023)).all()


def test_the_reference_itself_has_no_excess() -> None:
    column = np.where(np.arange(EDGE) // 16 % 2, 1.0, 1.01)
    banded = np.broadcast_to(column[None, :, None], (EDGE, EDGE, 3)).copy()
    flat = np.ones_like(banded)
    assert display_banding_excess(banded, banded[None], nits_per_unit=20.0).value == 0.0
    assert display_banding_excess(flat, banded[None], nits_per_unit=20.0).value == 0.0
    found = display_banding_excess(banded, flat[None], nits_per_unit=20.0)
    assert found.value == pytest.approx(display_banding(banded, nits_per_unit=20.0), rel=ROUNDING)
    assert "blind" in found.note


def test_small_pictures_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 63 x 63"):
        display_banding(np.ones((62, 80, 3)), nits_per_unit=1.0)
