"""Study "banding": bands of the glossy floor keep to their limits, and a planted fault does not."""

from __future__ import annotations

import pytest

from experiments.studies.banding.sweeps import LEAST_GAIN, MOST_BANDS, checks, sweep
from experiments.studies.check import StudyContext
from metrics.moving_bands import ratio_of_bands

pytestmark = pytest.mark.usefixtures("variant")

ALPHA = 0.1


@pytest.fixture(scope="module")
def context(variant: str) -> StudyContext:
    return StudyContext(quick=True, progress=lambda _step, _share: None)


def test_the_quick_study_has_one_roughness() -> None:
    quick = [check for check in checks() if check.in_quick]
    assert quick
    assert all(f"alpha {ALPHA:g}" in check.name for check in quick)


def test_short_steps_keep_to_the_limit_and_steps_times_four_do_not(context: StudyContext) -> None:
    short, long = (sweep(context, ALPHA, step, "off").power for step in (0.5, 2.0))
    assert short.high < MOST_BANDS < long.low


def test_noise_leaves_the_spread_and_takes_the_bands(context: StudyContext) -> None:
    off, noise, both = (sweep(context, ALPHA, 2.0, each) for each in ("off", "noise", "on"))
    assert noise.spread.value == pytest.approx(off.spread.value, rel=0.1)
    assert noise.power.high < off.power.low / LEAST_GAIN
    assert both.spread.high < off.spread.low / LEAST_GAIN
    assert ratio_of_bands(both.tile_powers, off.tile_powers).high < 1.0 / LEAST_GAIN
