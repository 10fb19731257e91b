"""A record says when its reference is too noisy, and a study's row is refused then."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.noise import noise_floors, noise_warnings
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.noise import require_told_apart
from experiments.studies.run import measured_row
from metrics import relmse_e2
from reference import NoisyReferenceError

SIZE, BATCHES = 24, 8


def batches(noise: float) -> np.ndarray:
    """Return batches of a picture of radiance 1, with so much noise in the mean of all."""
    rng = np.random.default_rng(5)
    spread = noise * np.sqrt(BATCHES)
    found: np.ndarray = 1.0 + spread * rng.standard_normal((BATCHES, SIZE, SIZE, 3))
    return found


def test_floors_are_those_of_components_with_light() -> None:
    found = noise_floors({"lit": batches(0.01), "dark": np.zeros((8, 4, 4, 3))}, 64)
    assert list(found) == ["lit"]
    # relMSE of the mean: 0.01^2 over 1 + 1 %
    assert found["lit"].value == pytest.approx(1e-4 / 1.01, rel=0.1)
    assert noise_floors({"few": batches(0.01)[:3]}, 64) == {}


def test_a_warning_names_the_component_and_the_remedy() -> None:
    loud = batches(0.1)
    floors = noise_floors({"indirect": loud}, 512)
    picture = np.full(loud.shape[1:], 1.2)
    measured = [relmse_e2(picture, loud, component="indirect")]
    (line,) = noise_warnings(floors, measured, 512)
    assert "too noisy for indirect" in line
    # Noise 0.01 against a difference of 0.04: 2.5 times as many paths, the next power of two
    assert line.endswith("--spp 2048")
    quiet = batches(0.01)
    measured = [relmse_e2(picture, quiet, component="indirect")]
    assert noise_warnings(noise_floors({"indirect": quiet}, 512), measured, 512) == []


def test_a_study_refuses_what_lies_in_the_noise() -> None:
    truth = batches(0.05)
    require_told_apart(np.full(truth.shape[1:], 1.5), truth, 64, "the truth")
    with pytest.raises(NoisyReferenceError, match="the truth is too noisy to compare"):
        require_told_apart(np.full(truth.shape[1:], 1.1), truth, 64, "the truth")
    with pytest.raises(NoisyReferenceError, match="too noisy to compare"):
        require_told_apart(np.ones(truth.shape[1:]), truth, 64, "the truth")


def test_a_refused_row_has_a_reason_and_no_number() -> None:
    def measure(context: StudyContext) -> Measured:
        raise NoisyReferenceError("too noisy:\nrender more")

    check = Check(name="n", configuration="c", scene="s", measure=measure, limit_high=1.0)
    row = measured_row("small", check, StudyContext(quick=True, progress=lambda *_: None))
    assert (row.value, row.passed, row.refused) == (None, False, "too noisy: render more")
