"""Study "fitted": shares sum to the whole, and a preset is compared with the one before."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from experiments.studies.check import StudyContext
from experiments.studies.fitted import budget, checks, comparison
from experiments.studies.fitted.budget import Budget, Effort, budget_of
from experiments.studies.fitted.comparison import comparison_of

TINY = Effort(resolution=16, places=2, spp=256)


SMALL = """format = 1
base = "medium"

[config.clipmap]
resolution = 16
"""


@pytest.fixture(scope="module")
def context(variant: str) -> StudyContext:
    return StudyContext(quick=True, progress=lambda _step, _share: None)


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    """Make all of it small, and return the preset that is looked at."""
    preset = tmp_path / "small.toml"
    preset.write_text(SMALL, encoding="utf-8")
    for module in (budget, comparison):
        monkeypatch.setattr(module, "EFFORT", (TINY, TINY))
        monkeypatch.setattr(module, "PRESET", str(preset))
    monkeypatch.setattr(budget, "MANY_CONES", 9)
    return str(preset)


def test_shares_sum_to_the_error_of_a_frame(context: StudyContext) -> None:
    found = budget_of(context, "cornell_box")
    parts = [getattr(found, each.name) for each in fields(Budget)]
    assert all(len(each) == TINY.places for each in parts)
    assert np.sum(parts[1:], axis=0) == pytest.approx(parts[0])
    # Independent noise only ever adds to a square.
    assert min(found.frame) > 0.0


def test_a_preset_beside_itself_is_the_same(context: StudyContext, small: str) -> None:
    found = comparison_of(context, "cornell_box", small)
    assert (found.error.value, found.samples) == (1.0, 1.0)
    assert math.isnan(found.rays), "neither traces rays, so that there is no ratio"
    assert found.milliseconds > 0.0


def test_checks_have_names_of_their_own() -> None:
    names = [each.name for each in checks()]
    assert len(set(names)) == len(names)
    assert "cornell_box, relMSE owned by sparse pixels" in names
