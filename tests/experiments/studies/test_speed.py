"""The study "speed": what is asked, where, and that its reads are counted and timed alike."""

from __future__ import annotations

import pytest

from experiments.doctor import LLVM_VARIANT
from experiments.studies.check import StudyContext
from experiments.studies.speed import checks, rows
from experiments.studies.speed.rows import (
    LEAST_TO_DENOISED,
    LEAST_TO_PATHS,
    MOST_TO_BARE,
    SCENES,
)

pytestmark = pytest.mark.usefixtures("variant")


def test_limits_hold_on_the_cpu_alone(variant: str) -> None:
    found = checks()
    assert len({check.name for check in found}) == len(found)
    lows = [check.limit_low for check in found if check.limit_low is not None]
    highs = [check.limit_high for check in found if check.limit_high is not None]
    if variant == LLVM_VARIANT:
        each = [LEAST_TO_PATHS, LEAST_TO_DENOISED, LEAST_TO_PATHS, LEAST_TO_DENOISED]
        assert lows == len(SCENES) * each
        assert highs == len(SCENES) * [MOST_TO_BARE]
    else:
        assert lows == highs == []


def test_bare_reads_are_faster_than_those_of_cones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "QUICK_SIZE", (24, 16))
    monkeypatch.setattr(rows, "READ_FRAMES", 2)
    context = StudyContext(quick=True, progress=lambda _step, _share: None)
    check = next(
        each
        for each in checks()
        if each.name == "cornell_box, rate of bare reads over that of cones"
    )
    assert check.measure(context).value > 1.0
