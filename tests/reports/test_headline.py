from __future__ import annotations

from collections.abc import Callable

import pytest

from reports.headline import (
    HEADLINES,
    duration,
    find_metric,
    frame_seconds,
    interval_text,
    is_below_noise,
    noise_bound,
    number,
)
from reports.record import Interval, MetricValue, NoiseFloor, Record, StageTime


def metric(name: str, value: float = 0.5, interval: Interval | None = None) -> MetricValue:
    return MetricValue(
        name=name, component="image", value=value, interval=interval, formula="f", ideal=0.0
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.000"),
        (1.0, "1.000"),
        (0.98712, "0.9871"),
        (0.0583, "0.0583"),
        (0.003121, "0.00312"),
        (-0.25, "\N{MINUS SIGN}0.2500"),
        (0.0000213, "2.13e\N{MINUS SIGN}5"),
        (-1.5e7, "\N{MINUS SIGN}1.50e7"),
        (12.345, "12.35"),
        (4096.4, "4096"),
        (123456.0, "123456"),
    ],
)
def test_numbers_keep_three_or_four_digits(value: float, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (None, "\N{EN DASH}"),
        (0.00061, "0.61 ms"),
        (0.274, "274 ms"),
        (48.2, "48.2 s"),
        (600.0, "10 min"),
    ],
)
def test_durations_have_a_unit(seconds: float | None, text: str) -> None:
    assert duration(seconds) == text


def test_an_interval_is_written_from_low_to_high() -> None:
    assert interval_text(Interval(low=-0.001, high=0.5)) == "\N{MINUS SIGN}0.00100 to 0.5000"
    assert interval_text(None) == ""


def test_the_first_metric_of_a_family_is_shown(make_record: Callable[..., Record]) -> None:
    record = make_record({}, metrics=[metric("relMSE (e2)", 0.1), metric("relmse_e001", 0.2)])
    relative = next(h for h in HEADLINES if (h.key, h.component) == ("relmse", "image"))
    found = find_metric(record, relative)
    assert found is not None
    assert found.value == 0.1
    assert [find_metric(record, h) is None for h in HEADLINES].count(False) == 1


def test_another_colour_difference_is_not_taken_for_itp(
    make_record: Callable[..., Record],
) -> None:
    record = make_record({}, metrics=[metric("delta_e_2000")])
    assert all(find_metric(record, headline) is None for headline in HEADLINES)


def test_only_an_error_whose_interval_reaches_zero_is_below_the_noise() -> None:
    assert is_below_noise(metric("mse", -0.1, Interval(low=-0.2, high=0.1)))
    assert not is_below_noise(metric("mse", 0.1, Interval(low=0.05, high=0.2)))
    assert not is_below_noise(metric("mse", -0.1))


def test_what_noise_hides_lies_under_the_larger_bound(make_record: Callable[..., Record]) -> None:
    record = make_record({})
    assert record.reference is not None
    floors = {"image": NoiseFloor(value=0.01, upper=0.02)}
    record = record.model_copy(
        update={"reference": record.reference.model_copy(update={"noise_floors": floors})}
    )
    tight = Interval(low=0.005, high=0.015)
    assert noise_bound(metric("relmse_e2", 0.01, tight), record) == 0.02
    assert noise_bound(metric("relmse_e2", 0.03, Interval(low=0.025, high=0.04)), record) is None
    assert noise_bound(metric("mse", 0.01, tight), record) is None
    assert noise_bound(metric("mse", 0.01, Interval(low=-0.1, high=0.3)), record) == 0.3
    assert noise_bound(metric("mse", 0.0, Interval(low=0.0, high=0.0)), record) is None


def test_a_frame_is_the_sum_of_its_stages_unless_it_was_timed_whole(
    make_record: Callable[..., Record],
) -> None:
    times = [
        StageTime(stage=stage, median_ms=ms, low_ms=ms, high_ms=ms, count=1)
        for stage, ms in (("inject", 10.0), ("trace", 20.0))
    ]
    whole = StageTime(stage="frame", median_ms=28.0, low_ms=28.0, high_ms=28.0, count=1)
    assert frame_seconds(make_record({}, times=times)) == pytest.approx(0.030)
    assert frame_seconds(make_record({}, times=[*times, whole])) == pytest.approx(0.028)
    assert frame_seconds(make_record({}, times=[])) is None
