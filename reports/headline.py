"""The few numbers of a record that are read first, and how numbers are written."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from reports.schema import Interval, MetricValue, Record

PRESET_ORDER = ("ambient", "medium", "high", "ultra")
"""Our own presets from cheap to dear; others follow by name, and other systems' recipes last."""

PEER_PREFIX = "peer:"
"""What names of other systems' recipes begin with."""

FRAME_STAGES = ("frame", "total")
"""A stage of this name is the time of a whole frame; without one, stages are added up."""


@dataclass(frozen=True, kw_only=True)
class Headline:
    """A metric that is shown at the top, found by the start of its name."""

    key: str
    label: str
    component: str
    explanation: str


HEADLINES = (
    Headline(
        key="energyratio",
        label="energy ratio",
        component="indirect",
        explanation="mean of the picture over mean of the reference; 1 is no energy gained or lost",
    ),
    Headline(
        key="relmse",
        label="relMSE",
        component="indirect",
        explanation="mean squared error relative to the squared reference, reference noise removed",
    ),
    Headline(
        key="energyratio",
        label="energy ratio",
        component="image",
        explanation="the same over the whole picture, whose direct light both sides share",
    ),
    Headline(
        key="relmse",
        label="relMSE",
        component="image",
        explanation="the same over the whole picture",
    ),
    Headline(
        key="flip",
        label="FLIP",
        component="image",
        explanation="how visible the difference is when the pictures alternate; 0 none, 1 all",
    ),
    Headline(
        key="ssim",
        label="SSIM",
        component="image",
        explanation="structural similarity of PQ-encoded luminance; 1 is the same",
    ),
    Headline(
        key="deltaeitp",
        label="ΔE-ITP",
        component="image",
        explanation="colour difference; 1 is about one just noticeable difference",
    ),
)
"""Columns of a summary, in order."""


def find_metric(record: Record, headline: Headline) -> MetricValue | None:
    """First metric of the record of this component whose name starts with the headline's key.

    Case, `_`, `-` and blanks in names do not matter: `relMSE (e = 0.01)` and `relmse_e2` both
    answer to `relmse`.
    """
    for metric in record.metrics:
        plain = re.sub(r"[^a-z0-9]", "", metric.name.lower())
        if metric.component == headline.component and plain.startswith(headline.key):
            return metric
    return None


def frame_seconds(record: Record) -> float | None:
    """Time of one frame of the method under test, seconds; None when no time was recorded."""
    if not record.times:
        return None
    whole = [time.median_ms for time in record.times if time.stage.lower() in FRAME_STAGES]
    return (whole[0] if whole else sum(time.median_ms for time in record.times)) / 1000.0


def samples_per_pixel(record: Record) -> float | None:
    """Return samples of the voxels a pixel, by all cones; None where they were not counted."""
    if record.cost is None:
        return None
    return record.cost.samples / (record.width * record.height)


def is_peer(record: Record) -> bool:
    """Whether a record was made by the recipe of another system."""
    return record.preset.startswith(PEER_PREFIX)


def is_below_noise(metric: MetricValue) -> bool:
    """Whether an error cannot be told from zero: its interval reaches down to zero or lower.

    Noise-aware estimates of squared errors may be negative; records keep them, never clamped.
    """
    return metric.ideal == 0.0 and metric.interval is not None and metric.interval.low <= 0.0


def noise_bound(metric: MetricValue, record: Record) -> float | None:
    """Return what an error lies below, where noise hides the error itself; None where it does not.

    It is hidden when its interval reaches zero, and a relMSE also when it is not above the noise of
    the reference. What is then known is the larger of both upper ends.
    """
    interval = metric.interval
    if metric.ideal != 0.0 or (interval is not None and interval.low == interval.high):
        return None
    floors = {} if record.reference is None else record.reference.noise_floors
    floor = floors.get(metric.component) if metric.name == "relmse_e2" else None
    is_under_floor = floor is not None and metric.value <= floor.upper
    if not is_below_noise(metric) and not is_under_floor:
        return None
    bounds = [] if interval is None else [interval.high]
    return max(bounds + ([floor.upper] if floor is not None and is_under_floor else []))


def ordered(records: Mapping[Path, Record]) -> list[tuple[Path, Record]]:
    """Sort records by scene name, then method, preset, back end, time, id.

    Presets: ours from cheap to dear, then any of other names, then the recipes of other systems.
    """
    places = {preset: place for place, preset in enumerate(PRESET_ORDER)}

    def rank(entry: tuple[Path, Record]) -> tuple[object, ...]:
        record = entry[1]
        return (
            record.scene.name,
            record.method,
            is_peer(record),
            places.get(record.preset, len(places)),
            # By parts, so that "peer:a:published" follows "peer:a" at once.
            tuple(record.preset.split(":")),
            record.machine.backend,
            record.created,
            record.record_id,
        )

    return sorted(records.items(), key=rank)


def number(value: float) -> str:
    """Write a number for a table.

    Three significant digits below 0.1, four up to 10 000, whole numbers above; powers of ten
    below 0.001 and from a million.
    """
    if value != 0.0 and not 1e-3 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.2e}".split("e")
        return f"{mantissa}e{int(exponent)}".replace("-", "\N{MINUS SIGN}")
    decade = 0 if value == 0.0 else math.floor(math.log10(abs(value)))
    decimals = 2 - decade if decade < -1 else max(0, 3 - decade)
    return f"{value:.{decimals}f}".replace("-", "\N{MINUS SIGN}")


def interval_text(interval: Interval | None) -> str:
    """Write an interval as `low to high`; empty without one."""
    if interval is None:
        return ""
    return f"{number(interval.low)} to {number(interval.high)}"


def count_text(value: float | None) -> str:
    """Write a count a pixel: whole from 10 on, one decimal below; a dash for None."""
    if value is None:
        return "\N{EN DASH}"
    return f"{value:,.0f}" if value >= 10.0 else f"{value:.1f}"


def duration(seconds: float | None) -> str:
    """Write a time in ms, s or min, three significant digits; a dash for None."""
    if seconds is None:
        return "\N{EN DASH}"
    if seconds < 1.0:
        return f"{seconds * 1000.0:.3g} ms"
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    return f"{seconds / 60.0:.3g} min"
