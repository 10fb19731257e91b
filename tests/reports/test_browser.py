"""The page in headless Chromium, from a file, as a reader opens it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from reports.accuracy import accuracy_report, write_accuracy_report
from reports.pictures import srgb_from_linear
from reports.record import load_image, read_record
from tests.reports.chromium import (
    PRINT_WIDTH,
    content_width,
    left_on_paper,
    needs_chromium,
    opened,
    printed,
    probed,
)

Write = Callable[..., Path]

pytestmark = needs_chromium

CODE_TOLERANCE = 2
"""8-bit codes: linear values are embedded to 0.4 % (7 mantissa bits), at most 1.2 codes of sRGB,
and each side rounds once."""


@pytest.fixture
def page(write: Write, awkward_name: str, tmp_path: Path) -> Path:
    no_reference = ("reference", "error", "flip", "reference_indirect")
    paths = [
        write(record_id="a"),
        write(record_id="b", name=awkward_name, warnings=[awkward_name]),
        write(record_id="c", name="alone", reference=None, metrics=[], drop_images=no_reference),
    ]
    return write_accuracy_report(paths, tmp_path / "report.html")


def test_the_page_opens_without_a_word_on_the_console(page: Path, tmp_path: Path) -> None:
    document, console = opened(page, tmp_path / "profile")
    assert console == ""
    assert '<html lang="en" class="js">' in document
    assert document.count('class="viewer"') == 2


@pytest.mark.parametrize("width", [400, 1400])
def test_nothing_is_wider_than_the_window(page: Path, tmp_path: Path, width: int) -> None:
    assert content_width(page, tmp_path / "profile", width) == width


def test_on_paper_nothing_is_cut_off_or_folded_away(page: Path, tmp_path: Path) -> None:
    paper = printed(page)
    assert content_width(paper, tmp_path / "profile", PRINT_WIDTH) == PRINT_WIDTH
    assert left_on_paper(paper, tmp_path / "profile") == (0, 0)


def test_keys_and_buttons_flip_and_slide(page: Path, tmp_path: Path) -> None:
    script = """
      const viewer = document.querySelector(".viewer");
      const shown = () => [viewer.classList.contains("flipping"),
        getComputedStyle(viewer.querySelector("img.ours")).visibility];
      const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", { key }));
      const states = [shown()];
      press("f"); states.push(shown());
      press("F"); states.push(shown());
      press("s"); states.push(shown());
      viewer.querySelector(".flip").click(); states.push(shown());
      const range = viewer.querySelector(".split-range");
      range.value = "25";
      range.dispatchEvent(new Event("input"));
      states.push(shown(), viewer.querySelector(".stage").style.getPropertyValue("--split"));
      return states;
    """
    assert probed(page, tmp_path / "profile", script) == [
        [False, "visible"],
        [True, "hidden"],
        [True, "visible"],
        [False, "visible"],
        [True, "hidden"],
        [False, "visible"],
        "25%",
    ]


def test_the_exposure_control_shows_what_python_would(write: Write, tmp_path: Path) -> None:
    path = write()
    record = read_record(path)
    page = tmp_path / "report.html"
    page.write_text(accuracy_report([path]), encoding="utf-8")
    script = """
      const viewer = document.querySelector(".viewer");
      const image = viewer.querySelector("img.reference");
      const before = image.src;
      const range = viewer.querySelector(".exposure-range");
      range.value = "-1.5";
      range.dispatchEvent(new Event("input"));
      for (let wait = 0; wait < 200 && image.src === before; wait++) {
        await new Promise((done) => setTimeout(done, 20));
      }
      await image.decode();
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      const seen = context.getImageData(0, 0, canvas.width, canvas.height).data;
      return [viewer.querySelector("output").textContent, Array.from(seen)];
    """
    label, seen = probed(page, tmp_path / "profile", script)
    assert label == "\N{MINUS SIGN}1.5 stops"
    linear = load_image(path, record, "reference")
    expected = srgb_from_linear(linear, exposure=record.display.exposure - 1.5)
    drawn = [seen[index] for index in range(len(seen)) if index % 4 != 3]
    worst = max(abs(a - int(b)) for a, b in zip(drawn, expected.ravel(), strict=True))
    assert worst <= CODE_TOLERANCE


def test_a_picture_is_enlarged_by_whole_pixels(page: Path, tmp_path: Path) -> None:
    script = """
      document.querySelector(".enlarge").click();
      const box = document.getElementById("lightbox");
      const image = box.querySelector("img");
      await image.decode();
      return [box.open, image.width % image.naturalWidth, image.width > image.naturalWidth,
        getComputedStyle(image).imageRendering];
    """
    assert probed(page, tmp_path / "profile", script) == [True, 0, True, "pixelated"]


def test_a_link_to_a_folded_record_opens_it(write: Write, tmp_path: Path) -> None:
    paths = [
        write(record_id=f"r{n}", preset=preset) for n, preset in enumerate(("high", "peer:compix"))
    ]
    page = write_accuracy_report(paths, tmp_path / "page.html")
    found = probed(
        page,
        tmp_path / "profile",
        "const records = [...document.querySelectorAll('details.record')];"
        "const before = records.map((record) => record.open);"
        "document.querySelector('.method h4 a').click();"
        "await new Promise((done) => setTimeout(done, 200));"
        "return [before, records.map((record) => record.open)];",
    )
    assert found == [[False, False], [True, False]]
