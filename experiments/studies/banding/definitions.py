"""What the numbers of the study "banding" are."""

from __future__ import annotations

from metrics.banding import PHASE_SPREAD_FORMULA
from metrics.moving_bands import FORMULA
from reports.study_figures import Definition

DEFINITIONS = (
    Definition(
        name="B1, spread over start phases",
        formula=PHASE_SPREAD_FORMULA,
        source="metrics/moving_bands.py, spread: the root of its mean over tiles, interval over "
        "tiles; of a chosen scene metrics/banding.py, phase_spread, interval over phases",
    ),
    Definition(
        name="B2, bands",
        formula=FORMULA,
        source="metrics/moving_bands.py, power: pictures demodulated like a lock-in amplifier "
        "does; interval over tiles",
    ),
    Definition(
        name="B2 off over on",
        formula="B2 without noise and filter / B2 with both, of the same tiles",
        source="metrics/moving_bands.py, ratio_of_bands",
    ),
)
