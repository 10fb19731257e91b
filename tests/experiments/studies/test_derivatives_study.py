"""Study "derivatives": its list of checks, and how it moves and compares."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.derivatives.measure import (
    by_differences,
    by_forward_mode,
    by_reverse_mode,
    disagreement,
    moved,
)

pytestmark = pytest.mark.usefixtures("variant")


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("derivatives"))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


@pytest.mark.parametrize("start", [[2.0], [0.5, 1.0, 4.0]])
def test_all_three_ways_are_the_derivative_by_the_share(start: list[float]) -> None:
    """Of the mean of (sum of x)^2 and 0 by the share s at which each x becomes x (1 + s w)."""
    values = mi.Float(start)

    def picture(x: mi.Float) -> mi.Float:
        return mi.Float(dr.square(dr.sum(x)) * mi.Float(1.0, 0.0))

    step = 1e-3
    total = float(np.sum(start))
    slope = float(np.sum(np.array(moved(values, 1.0)) - np.array(start)))
    wanted = total * slope
    for found in (by_forward_mode(picture, values), by_reverse_mode(picture, values)):
        assert found == pytest.approx(wanted, rel=1e-6)
    # The square's differences are exact but for rounding over the step
    assert by_differences(picture, values, step) == pytest.approx(wanted, rel=1e-3)


def test_a_derivative_that_hardly_counts_is_compared_to_the_mean() -> None:
    assert disagreement(1.1, 1.0, 1.0) == pytest.approx(0.1)
    assert disagreement(0.001, 0.0, 1.0) == pytest.approx(0.05)
