"""Display-referred metrics compare only between records that were shown in the same way."""

from __future__ import annotations

import math
import re
from typing import Final

from experiments.gate.baseline import Baseline
from experiments.gate.finding import UPDATE_REMEDY, Finding
from reports.record import Display, Record

DISPLAY_REFERRED: Final = ("flip", "ssim", "delta_e")
"""First words of the names of metrics that look at a picture as a display shows it."""
DISPLAY_STOPS: Final = 0.01
"""How far brightness and exposures may move: 0.01 stops changed a mean FLIP by 0.3 %, 0.1 stops by
3 %. They follow from the reference, so that another seed moves them; a render that measures with
`pinned_display` moves them not at all."""
NUMBER: Final = re.compile(r"[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def is_display_referred(metric: str) -> bool:
    """Say whether a metric's value depends on the display."""
    return metric.startswith(DISPLAY_REFERRED)


def check_display(record: Record, baseline: Baseline) -> Finding:
    """Compare how two records were shown, up to `DISPLAY_STOPS`."""
    now, then = record.display, baseline.display
    shift = max(
        abs(now.flip_start_exposure - then.flip_start_exposure),
        abs(now.flip_stop_exposure - then.flip_stop_exposure),
        abs(now.exposure - then.exposure),
        abs(math.log2(now.nits_per_unit / then.nits_per_unit)),
    )
    is_same_view = (now.flip_exposure_count, now.flip_pixels_per_degree) == (
        then.flip_exposure_count,
        then.flip_pixels_per_degree,
    )
    passed = is_same_view and shift <= DISPLAY_STOPS
    remedy = f"render with the baseline's display, or, {UPDATE_REMEDY}"
    return Finding(
        kind="exact",
        passed=passed,
        value=shift,
        limit=f"<= {DISPLAY_STOPS:g} stops apart, same FLIP count and pixels per degree",
        message="the same" if passed else f"{now!r}, the baseline has {then!r}; {remedy}",
    )


def same_formula(metric: str, now: tuple[str, Display], then: tuple[str, Display]) -> bool:
    """Compare two formulas, each given with the display of its record.

    The numbers of a display-referred formula that are the display's own are left out:
    `check_display` compares those, with a tolerance that a formula's text has not.
    """
    if not is_display_referred(metric):
        return now[0] == then[0]
    return _without_display(*now) == _without_display(*then)


def _without_display(formula: str, display: Display) -> str:
    values = (
        display.nits_per_unit,
        display.exposure,
        display.flip_start_exposure,
        display.flip_stop_exposure,
    )

    def placeholder(match: re.Match[str]) -> str:
        number = float(match.group())
        # A formula rounds to 3 decimals or 6 digits.
        is_own = any(math.isclose(number, v, rel_tol=1e-5, abs_tol=6e-4) for v in values)
        return "(display)" if is_own else match.group()

    return NUMBER.sub(placeholder, formula)
