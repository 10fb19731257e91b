"""Several records of a scene on one page, side by side."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from reports.accuracy import accuracy_report
from reports.headline import ordered, samples_per_pixel
from reports.label_places import Box, place_labels
from reports.markdown import markdown_summary
from reports.method_plot import method_svg
from reports.methods import compare, grouped
from reports.pictures import Floats, error_scale, reduced, signed_map
from reports.record import FrameCost, MetricValue, Record, read_record
from reports.schema import Interval
from tests.reports.test_accuracy import Page, assert_loads_nothing

Write = Callable[..., Path]
MakeRecord = Callable[..., Record]

OURS = ("ultra", "high", "medium")
PEERS = ("peer:compix:published", "peer:compix", "peer:wicked")

SIZE_LIMIT = 20_000_000
"""Bytes of a page of six scenes and as many methods as there are recipes."""

RECIPE_COUNT = 25


def cost(samples: int = 4608) -> FrameCost:
    return FrameCost(
        gathering_cones=200,
        gathering_samples=samples,
        specular_cones=10,
        specular_samples=1536,
        near_field_rays=77,
        voxel_bytes=3 << 20,
    )


def written(write: Write, presets: tuple[str, ...] = OURS + PEERS) -> list[Path]:
    return [
        write(record_id=f"r{number}", preset=preset, cost=cost(4608 * (number + 1)))
        for number, preset in enumerate(presets)
    ]


def relmse(value: float, low: float, high: float) -> MetricValue:
    return MetricValue(
        name="relmse_e2", component="indirect", value=value, formula="", ideal=0.0,
        interval=Interval(low=low, high=high),
    )  # fmt: skip


def test_a_record_without_a_cost_still_reads(write: Write) -> None:
    path = write()
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content.pop("cost") is None
    path.write_text(json.dumps(content), encoding="utf-8")
    record = read_record(path)
    assert record.cost is None
    assert samples_per_pixel(record) is None
    assert "samples of the voxels a pixel" not in accuracy_report([path])


def test_a_cost_is_read_back_and_shown(write: Write) -> None:
    path = write(cost=cost())
    record = read_record(path)
    assert record.cost == cost()
    # 48 x 32 pixels.
    assert samples_per_pixel(record) == 4.0
    words = Page(accuracy_report([path])).words
    for text in ("samples of the voxels a pixel4.0", "77 real rays", "3 MiB", "4,608 along 200"):
        assert text in words, text
    assert "| 4.0 |" in markdown_summary([path])


def test_ours_come_first_from_cheap_to_dear_then_the_recipes_of_others(write: Write) -> None:
    paths = written(write, ("peer:compix32", *PEERS, "custom", *OURS))
    presets = [record.preset for _, record in ordered({p: read_record(p) for p in paths})]
    assert presets == [
        "medium",
        "high",
        "ultra",
        "custom",
        "peer:compix",
        PEERS[0],
        "peer:compix32",
        PEERS[2],
    ]


def test_only_records_of_one_reference_stand_side_by_side(write: Write) -> None:
    first, second = (read_record(path) for path in written(write, OURS[:2]))
    assert second.reference is not None
    other = second.model_copy(
        update={"reference": second.reference.model_copy(update={"key": "another"})}
    )
    assert len(grouped([(Path("a"), first), (Path("b"), second)])) == 1
    assert len(grouped([(Path("a"), first), (Path("b"), other)])) == 2


def test_the_page_compares_all_and_folds_each_away(write: Write) -> None:
    paths = [*written(write), write(record_id="other", name="rooms")]
    text = accuracy_report(paths)
    assert text == accuracy_report(paths[::-1])
    assert_loads_nothing(text)
    page = Page(text)
    assert set(page.values("href")) <= {f"#{key}" for key in page.values("id")} | {"#"}
    assert page.words.count("Methods side by side") == 1
    folded = [
        attrs for tag, attrs in page.tags if tag == "details" and attrs.get("class") == "record"
    ]
    assert len(folded) == 6
    assert not any("open" in attrs for attrs in folded)
    methods = [attrs for tag, attrs in page.tags if tag == "article"]
    assert [("is-ours" in (attrs["class"] or "")) for attrs in methods] == [True] * 3 + [False] * 3
    # Ours and the other scene keep their viewers; recipes of others are in the grid only.
    assert sum("viewer" in (attrs.get("class") or "").split() for _, attrs in page.tags) == 4
    summary = page.words.split("How to read this")[1]
    assert "vctgi ultra" in summary
    assert "vctgi peer:wicked" not in summary
    assert "6 methods side by side" in summary
    # The dearest of ours has its components, and so has the other scene.
    assert page.words.count("Components") == 2
    assert page.words.count("What its materials contribute") == 2


def test_one_record_a_scene_is_no_comparison(write: Write) -> None:
    text = accuracy_report([write(), write(record_id="other", name="rooms", preset=PEERS[1])])
    assert "Methods side by side" not in text
    assert '<details class="record"' not in text


def test_all_errors_have_one_scale_and_one_wild_method_does_not_set_it(
    write: Write, pictures: Callable[[int, int], dict[str, Floats]]
) -> None:
    paths = written(write)
    records = [(path, read_record(path)) for path in paths]
    found = compare("k", records, dict.fromkeys(paths, "s"))
    assert {m.error.scale for m in found.methods if m.error is not None} == {found.scale}
    error = pictures(48, 32)["error"]
    assert found.scale == error_scale([error])
    wild_error = np.asarray(1000.0 * error, np.float32)
    assert error_scale([error, error, wild_error]) == found.scale
    wild = signed_map(wild_error, found.scale)
    assert wild.scale == found.scale
    assert wild.exceeding_share > 0.5


def test_a_reduced_picture_keeps_the_mean() -> None:
    values = np.random.default_rng(3).random((40, 64, 3), dtype=np.float32)
    small = reduced(values, 16)
    assert small.shape == (10, 16, 3)
    assert small.mean() == pytest.approx(values.mean(), rel=1e-5)
    assert reduced(values[..., 0], 64).shape == (40, 64)


@pytest.mark.parametrize("missing", ["indirect", "reference_indirect", "error"])
def test_any_picture_of_a_comparison_may_be_missing(write: Write, missing: str) -> None:
    paths = [
        write(record_id=f"r{n}", preset=preset, drop_images=(missing,))
        for n, preset in enumerate(OURS)
    ]
    Page(accuracy_report(paths))


def test_the_chart_names_every_method_once(make_record: MakeRecord) -> None:
    errors = dict(zip(OURS + PEERS, (0.01, 0.02, 0.03, 2.0, 0.2, 1.0), strict=True))
    records = [
        make_record({}, preset=p, cost=cost(1000 * n), metrics=[relmse(v, 0.9 * v, 1.1 * v)])
        for n, (p, v) in enumerate(errors.items())
    ]
    svg = method_svg(records, key="c")
    assert svg is not None
    assert svg == method_svg(records, key="c")
    texts = [node.text for node in ElementTree.fromstring(svg).iter() if node.tag == "text"]
    # The scaled recipe is joined to the plain one, whose name is for both.
    for name in (*OURS, "compix", "wicked"):
        assert texts.count(name) == 2, name
    assert "compix:published" not in texts


@pytest.mark.parametrize(
    "metric", [relmse(-0.01, -0.02, 0.03), relmse(0.02, -0.01, 0.03), relmse(-0.1, -0.2, -0.1)]
)
def test_the_chart_takes_errors_below_the_noise(
    make_record: MakeRecord, metric: MetricValue
) -> None:
    fine = [make_record({}, preset=p, cost=cost(), metrics=[relmse(0.1, 0.1, 0.1)]) for p in OURS]
    svg = method_svg([*fine, make_record({}, cost=cost(), metrics=[metric])], key="c")
    assert svg is not None
    assert not re.search(r"\b(nan|inf)\b", svg)


def test_without_two_points_there_is_no_chart(make_record: MakeRecord) -> None:
    assert method_svg([make_record({}), make_record({}, metrics=[])], key="c") is None


def test_labels_cover_neither_points_nor_each_other() -> None:
    rng = np.random.default_rng(1)
    points = [(float(x), float(y)) for x, y in rng.uniform(30.0, 270.0, (24, 2))]
    names = [f"method{n}" for n in range(16)]
    frame = Box(0.0, 0.0, 300.0, 300.0)
    places = place_labels(points, names, frame, 8.0)
    half = 0.5 * 0.58 * 8.0 * len("method0")
    boxes = [Box(p.x - half, p.y - 4.8, p.x + half, p.y + 4.8) for p in places if p is not None]
    assert len(boxes) == len(names)
    for number, box in enumerate(boxes):
        assert box.is_inside(frame)
        assert not any(box.overlaps(other) for other in boxes[:number])
        assert not any(box.overlaps(Box(x - 4, y - 4, x + 4, y + 4)) for x, y in points)
    assert place_labels(points[:1], names[:1], Box(0.0, 0.0, 5.0, 5.0), 8.0) == [None]


def test_six_scenes_of_all_methods_fit_in_a_mail(write: Write) -> None:
    paths = [
        write(record_id=f"r{n}", preset=preset, cost=cost(), width=256, height=256)
        for n, preset in enumerate((*OURS, *PEERS))
    ]
    ours, all_six = (len(accuracy_report(part).encode()) for part in (paths[:3], paths))
    recipe = (all_six - ours) / len(PEERS)
    assert 6 * (ours + RECIPE_COUNT * recipe) < SIZE_LIMIT
