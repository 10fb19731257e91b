from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable

import pytest

from reports.plots import overview_svg, stage_time_svg
from reports.record import Interval, MetricValue, Record, StageTime

MakeRecord = Callable[..., Record]

TIMES = [
    StageTime(stage="trace $x^2$ <b>&", median_ms=20, low_ms=19, high_ms=24, count=5),
    StageTime(stage="inject", median_ms=5, low_ms=5, high_ms=5, count=1),
]


def relmse(value: float, low: float, high: float) -> MetricValue:
    return MetricValue(
        name="relmse_e2",
        component="indirect",
        value=value,
        interval=Interval(low=low, high=high),
        formula="f",
        ideal=0.0,
    )


def test_a_chart_is_well_formed_and_deterministic() -> None:
    first, second = (stage_time_svg(TIMES, key="k") for _ in range(2))
    assert first == second
    texts = [element.text for element in ElementTree.fromstring(first).iter("text")]
    assert "trace $x^2$ <b>&" in texts
    assert "inject" in texts


def test_a_chart_takes_the_colours_and_fonts_of_its_page() -> None:
    svg = stage_time_svg(TIMES, key="k")
    assert "currentColor" in svg
    assert "#010203" not in svg
    assert "#ffffff" not in svg
    assert "font-family" not in svg
    assert "<style" not in svg


def test_identifiers_belong_to_one_chart() -> None:
    svg = stage_time_svg(TIMES, key="k7")
    identifiers = re.findall(r'\bid="([^"]*)"', svg)
    used = re.findall(r'(?:href="#|url\(#)([^")]*)', svg)
    assert used
    assert all(name.startswith("k7-") for name in identifiers)
    assert set(used) <= set(identifiers)


def test_no_time_has_no_chart() -> None:
    with pytest.raises(ValueError, match="no stage time given; leave the chart out"):
        stage_time_svg([], key="k")


def test_an_overview_without_numbers_is_left_out(make_record: MakeRecord) -> None:
    assert overview_svg([make_record({}, metrics=[])], key="k") is None


@pytest.mark.parametrize(
    "metrics",
    [
        [relmse(0.02, 0.01, 0.03)],
        [relmse(0.02, 0.00001, 0.9)],
        [relmse(-0.02, -0.03, 0.01)],
        [relmse(0.0, 0.0, 0.0)],
        [relmse(1e-4, 1e-4, 1e-4), relmse(0.5, 0.5, 0.5)],
    ],
)
def test_an_overview_takes_any_error(make_record: MakeRecord, metrics: list[MetricValue]) -> None:
    records = [make_record({}, metrics=[metric]) for metric in metrics]
    records.append(make_record({}, metrics=[]))
    svg = overview_svg(records, key="k")
    assert svg is not None
    ElementTree.fromstring(svg)
