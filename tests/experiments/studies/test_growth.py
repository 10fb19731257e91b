"""The study "growth": exponents of known laws, and what its axes make larger."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.studies.check import StudyContext
from experiments.studies.growth import checks
from experiments.studies.growth.axes import AXES, COUNT, DEVICE, costs_of
from experiments.studies.growth.exponents import Cost, fitted_exponent, last_exponent
from experiments.studies.growth.rows import LINEAR

pytestmark = pytest.mark.usefixtures("variant")


def costs(sizes: list[float], law: float, fixed: float = 0.0) -> list[Cost]:
    values = [fixed + size**law for size in sizes]
    return [Cost(x, y, y, y) for x, y in zip(sizes, values, strict=True)]


@pytest.mark.parametrize("law", [0.5, 1.0, 1.5])
def test_the_exponent_of_a_power_is_it(law: float) -> None:
    found = costs([10.0, 100.0, 1000.0, 10_000.0], law)
    assert fitted_exponent(found).value == pytest.approx(law)
    assert last_exponent(found).value == pytest.approx(law)


def test_the_last_step_sees_past_a_fixed_cost() -> None:
    found = costs([10.0, 100.0, 1000.0, 10_000.0], 1.0, fixed=500.0)
    assert fitted_exponent(found).value < 0.7
    assert last_exponent(found).value > 0.8


def test_n_log_n_counts_as_linear_and_a_square_does_not() -> None:
    sizes = [2e4, 2e5, 2e6]
    values = [x * np.log(x) for x in sizes]
    assert last_exponent([Cost(x, y, y, y) for x, y in zip(sizes, values, strict=True)]).value < (
        LINEAR
    )
    assert last_exponent(costs(sizes, 2.0)).value > LINEAR


def test_intervals_hold_the_repetitions() -> None:
    found = [Cost(1.0, 1.0, 0.9, 1.1), Cost(10.0, 10.0, 9.0, 12.0)]
    last = last_exponent(found)
    assert last.low is not None
    assert last.high is not None
    assert last.low < last.value < last.high
    assert fitted_exponent(found).low is None


def test_nothing_has_no_exponent() -> None:
    with pytest.raises(ValueError, match="two sizes"):
        fitted_exponent(costs([1.0], 1.0))
    with pytest.raises(ValueError, match="cost of 0"):
        last_exponent([Cost(1.0, 0.0, 0.0, 0.0), Cost(2.0, 1.0, 1.0, 1.0)])


def test_every_axis_is_held_to_proportion_or_says_why_not() -> None:
    found = checks()
    assert len({check.name for check in found}) == len(found)
    for axis in AXES:
        own = [check for check in found if check.name.startswith(f"{axis.name}: ")]
        limits = {check.limit_high for check in own if "memory" not in check.name}
        assert limits == ({None} if axis.note else {LINEAR})
        assert {check.limit_high for check in own if "memory" in check.name} == {LINEAR}


def test_reads_grow_with_the_pixels() -> None:
    axis = next(each for each in AXES if each.name == "pixels")
    context = StudyContext(quick=True, progress=lambda _step, _share: None)
    found = costs_of(context, axis)
    assert last_exponent(found[COUNT]).value == pytest.approx(1.0, abs=0.01)
    assert all(each.value > 0.0 for each in found[DEVICE])
