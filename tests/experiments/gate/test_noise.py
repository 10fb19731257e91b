"""A record whose reference is too noisy is not judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from experiments.errors import MachineryError
from experiments.gate.evaluation import evaluate, exit_code
from experiments.gate.noise import check_noise
from reports.record import NoiseFloor, Record
from tests.experiments.gate.conftest import ENERGY_BOUNDS

if TYPE_CHECKING:
    from tests.experiments.gate.conftest import Bench


def with_floor(record: Record, upper: float) -> Record:
    assert record.reference is not None
    floors = {"indirect": NoiseFloor(value=0.9 * upper, upper=upper)}
    reference = record.reference.model_copy(update={"noise_floors": floors})
    return record.model_copy(update={"reference": reference})


def difference_of(record: Record) -> float:
    (found,) = [m.value for m in record.metrics if m.name == "relmse_e2"]
    return found


def test_the_difference_must_be_ten_times_the_noise(bench: Bench) -> None:
    record, path = bench.record(seed=3)
    difference = difference_of(record)
    gate = bench.gate()
    quiet = check_noise(with_floor(record, 0.099 * difference), gate)
    assert quiet is not None
    assert quiet.value == pytest.approx(1.0 / 0.099)
    noisy = with_floor(record, 0.2 * difference)
    with pytest.raises(MachineryError, match="set reference_spp to at least 10"):
        check_noise(noisy, gate)
    verdicts = evaluate(noisy, path, gate, bench.baseline(gate))
    assert exit_code(verdicts) == 3


def test_a_gate_may_ask_about_a_smaller_difference(bench: Bench) -> None:
    record, _ = bench.record(seed=3)
    gate = bench.gate(smallest_difference=1e-4)
    with pytest.raises(MachineryError, match=r"not 10 times below 0\.0001"):
        check_noise(record, gate)


def test_a_record_that_does_not_tell_is_refused(bench: Bench) -> None:
    record, _ = bench.record(seed=3)
    assert record.reference is not None
    silent = record.reference.model_copy(update={"noise_floors": {}})
    with pytest.raises(MachineryError, match="does not say how noisy"):
        check_noise(record.model_copy(update={"reference": silent}), bench.gate(ENERGY_BOUNDS))


def test_equality_has_a_test_of_its_own(bench: Bench) -> None:
    record, _ = bench.record(seed=3, render=bench.truth, method="path")
    equal: dict[str, object] = {
        "kind": "equal",
        "metric": "energy_ratio",
        "component": "indirect",
        "scale": "ratio",
    }
    assert check_noise(record, bench.gate(equal)) is None
