from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from reports.accuracy import accuracy_report, write_accuracy_report
from reports.record import Record, read_record, write_image, write_record

Write = Callable[..., Path]

SIZE_LIMIT = 20_000_000
"""Bytes of a report of ten scenes of 320 x 320 pixels, so that it can be mailed."""

REFERENCE_IMAGES = ("reference", "error", "flip", "reference_indirect")

# Elements that HTML closes by itself.
VOID = {"img", "input", "meta", "br", "hr", "link"}


class Page(HTMLParser):
    """Tags, text and identifiers of a page; fails on tags that do not nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] not in ("script", "style"):
            self.words += data

    def values(self, attribute: str) -> list[str]:
        return [attrs[attribute] or "" for _, attrs in self.tags if attribute in attrs]


def assert_loads_nothing(text: str) -> None:
    page = Page(text)
    sources = page.values("src") + page.values("href") + page.values("xlink:href")
    sources += re.findall(r"url\(([^)]*)\)", text)
    assert sources
    for source in sources:
        assert source.startswith(("#", "data:image/png;base64,", "data:image/jpeg;base64,")), source
    assert "http://" not in text
    assert "https://" not in text
    assert "@import" not in text
    assert {tag for tag, _ in page.tags}.isdisjoint({"link", "iframe", "object", "embed", "base"})


def test_a_report_loads_nothing_and_its_links_lead_somewhere(write: Write) -> None:
    text = accuracy_report([write(record_id="a"), write(record_id="b", name="rooms")])
    assert_loads_nothing(text)
    page = Page(text)
    identifiers = page.values("id")
    assert len(identifiers) == len(set(identifiers))
    targets = {href[1:] for href in page.values("href") if href.startswith("#")}
    assert targets <= set(identifiers)


def test_the_same_records_give_the_same_bytes(write: Write, tmp_path: Path) -> None:
    paths = [write(record_id="a"), write(record_id="b", name="rooms")]
    first = write_accuracy_report(paths, tmp_path / "new" / "1.html")
    second = write_accuracy_report(paths[::-1], tmp_path / "2.html")
    assert first.read_bytes() == second.read_bytes()


def test_a_row_and_a_section_per_record_sorted_by_name(write: Write) -> None:
    paths = [write(record_id=name, name=name) for name in ("rooms", "box")]
    paths.append(write(record_id="again", name="box", preset="ultra"))
    words = Page(accuracy_report(paths)).words
    summary, *sections = words.split("Make it again")[0].split("How to read this")[1:]
    assert "3 records of 2026-01-31" in words
    assert len(sections) == 1
    positions = [words.index(f"Synthetic {name}") for name in ("box", "rooms")]
    assert positions == sorted(positions)
    assert words.count("Synthetic box") == 4
    assert "vctgi ultra" in summary


def test_everything_that_a_record_holds_is_shown(write: Write) -> None:
    path = write()
    record = read_record(path)
    words = " ".join(Page(accuracy_report([path])).words.split())
    reference = record.reference
    assert reference is not None
    facts = [
        record.command,
        record.record_id,
        record.machine.commit,
        record.machine.device,
        record.scene.purpose,
        record.scene.digest,
        reference.key,
        "8.3 % of the reflected light has more",
        "read from the cache this time",
        "4,096 in 16 independent batches",
        "relMSE 2.10e\N{MINUS SIGN}5",
        "mitsuba 3.9.1",
        "55 cd m",
        "[0.9260 to 0.9364]",
        "below the noise",
        "no interval",
        "of pixels lie beyond it",
        '"aperture": 0.6',
        "reference 48.2 s, 176 \N{MULTIPLICATION SIGN}",
        *(time.stage for time in record.times),
        *(entry.reason for entry in record.plan),
        *(entry.bound for entry in record.plan),
        *(entry.override for entry in record.plan),
        *(metric.formula for metric in record.metrics),
        *record.scene.contributions,
    ]
    assert [fact for fact in facts if fact not in words] == []


def test_no_name_can_become_markup(
    write: Write, make_scene: Callable[..., object], awkward_name: str
) -> None:
    scene = make_scene(
        awkward_name,
        **dict.fromkeys(("title", "source", "purpose", "credit"), awkward_name),
        emitters={awkward_name: 1},
        contributions=[awkward_name],
        unsupported=[awkward_name],
    )
    plain = Page(accuracy_report([write(record_id="plain")]))
    text = accuracy_report(
        [
            write(
                record_id="awkward",
                scene=scene,
                command=awkward_name,
                preset=awkward_name,
                config={awkward_name: awkward_name},
                warnings=[awkward_name],
            )
        ]
    )
    assert_loads_nothing(text)
    page = Page(text)
    assert "<b>" not in text
    assert page.words.count(awkward_name) >= 9
    assert [tag for tag, _ in page.tags].count("script") == [t for t, _ in plain.tags].count(
        "script"
    )


def test_warnings_are_shown_above_the_pictures(
    write: Write, make_scene: Callable[..., object]
) -> None:
    scene = make_scene("box", unsupported=["hair: left dark"])
    words = Page(accuracy_report([write(scene=scene, warnings=["3 triangles skipped"])])).words
    assert "2 warnings" in words
    first_picture = words.index("Signed error")
    assert words.index("3 triangles skipped") < words.index("hair: left dark") < first_picture


def test_uncommitted_changes_are_a_warning(
    write: Write, make_record: Callable[..., Record]
) -> None:
    machine = make_record({}).machine.model_copy(update={"is_dirty": True})
    words = Page(accuracy_report([write(machine=machine)])).words
    assert "Made from uncommitted changes on top of 0123456789ab" in words


def test_a_record_without_reference_says_so(write: Write) -> None:
    path = write(
        reference=None,
        metrics=[],
        times=[],
        plan=[],
        drop_images=(
            *REFERENCE_IMAGES,
            "reference_indirect_diffuse",
            "reference_indirect_specular",
        ),
    )
    text = accuracy_report([path])
    assert_loads_nothing(text)
    words = Page(text).words
    assert "No reference was recorded: nothing here says how wrong the picture is." in words
    assert "There is no reference picture to compare with." in words
    assert "Signed error" not in words
    assert "No times were recorded." in words
    assert "no reference picture" in words


@pytest.mark.parametrize("missing", ["image", "error", "flip", "depth", "indirect", "direct"])
def test_any_picture_may_be_missing(write: Write, missing: str) -> None:
    text = accuracy_report([write(drop_images=(missing,))])
    assert_loads_nothing(text)
    no_picture = "No picture of the method was recorded." in Page(text).words
    assert no_picture == (missing == "image")


def test_a_record_without_any_picture_is_shown(write: Write) -> None:
    record = read_record(write())
    bare = write(record_id="bare", drop_images=tuple(record.images))
    assert "No picture of the method was recorded." in accuracy_report([bare])


def test_pixels_that_are_not_finite_are_counted(
    make_record: Callable[..., Record], tmp_path: Path
) -> None:
    image = np.full((8, 8, 3), 0.5, np.float32)
    image[2, 3, 1] = np.nan
    image[4, 5] = np.inf
    depth = np.full((8, 8), np.inf, np.float32)
    images = {
        "image": write_image(tmp_path / "run" / "image.exr", image, ""),
        "depth": write_image(tmp_path / "run" / "depth.exr", depth, ""),
    }
    path = write_record(make_record(images, width=8, height=8), tmp_path)
    text = accuracy_report([path])
    assert "2 pixel(s) of image are not finite" in text
    assert "of depth are not finite" not in text


def test_a_large_picture_has_no_exposure_control(write: Write) -> None:
    small, large = (
        accuracy_report([write(record_id=f"w{width}", width=width, height=400)])
        for width in (400, 700)
    )
    assert 'class="linear-ours"' in small
    assert 'class="linear-ours"' not in large
    assert "has no exposure control" in large


def test_ten_scenes_fit_in_a_mail(write: Write) -> None:
    one = len(accuracy_report([write(width=320, height=320)]))
    assert 10 * one < SIZE_LIMIT


def test_an_altered_picture_stops_the_report(write: Write, records_folder: Path) -> None:
    path = write()
    (records_folder / "cornell-high-0001" / "image.exr").write_bytes(b"other")
    with pytest.raises(ValueError, match=r"image\.exr: image 'image' was altered"):
        accuracy_report([path])


def test_no_record_is_refused() -> None:
    with pytest.raises(ValueError, match="no record given; make one"):
        accuracy_report([])


def test_reports_do_not_load_a_renderer() -> None:
    modules = "accuracy, headline, image_files, junit, markdown, pictures, plots, record, sections"
    code = (
        f"import sys; from reports import {modules}; "
        "sys.exit(sum(name in sys.modules for name in ('mitsuba', 'drjit', 'vctgi', 'reference')))"
    )
    root = Path(__file__).parents[2]
    assert subprocess.run([sys.executable, "-c", code], cwd=root, check=False).returncode == 0
