"""The page in headless Chromium, from a file, as a reader opens it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from reports.accuracy import accuracy_report, write_accuracy_report
from reports.pictures import srgb_from_linear
from reports.record import load_image, read_record

Write = Callable[..., Path]

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="headless Chromium is missing: install the package chromium"
)

TIME_LIMIT_S = 120.0

CODE_TOLERANCE = 2
"""8-bit codes: linear values are embedded to 0.4 % (7 mantissa bits), at most 1.2 codes of sRGB,
and each side rounds once."""


def opened(page: Path, profile: Path, *flags: str) -> tuple[str, str]:
    """Document after the script ran, and what the console said."""
    assert CHROMIUM is not None
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--hide-scrollbars",
        "--enable-logging=stderr",
        "--v=0",
        f"--user-data-dir={profile}",
        "--virtual-time-budget=10000",
        *flags,
        "--dump-dom",
        page.as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=True)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return done.stdout, "\n".join(console)


def probed(page: Path, profile: Path, script: str, *flags: str) -> Any:
    """Run a script, the body of an async function, at the end of a page; return its result."""
    text = page.read_text(encoding="utf-8")
    probe = (
        "<script>(async () => { document.body.dataset.probe = JSON.stringify(await (async () => {"
        f"{script}"
        "})()); })();</script></body>"
    )
    copy = page.with_name("probed.html")
    copy.write_text(text.replace("</body>", probe), encoding="utf-8")
    document, console = opened(copy, profile, *flags)
    assert console == ""
    found = re.search(r'<body data-probe="([^"]*)"', document)
    assert found is not None, "the probe did not finish"
    return json.loads(found.group(1).replace("&quot;", '"'))


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
    # In a frame, because a headless window has at least 500 pixels.
    message = "<script>parent.postMessage([document.documentElement.scrollWidth, innerWidth], '*')"
    framed = page.with_name("framed.html")
    text = page.read_text(encoding="utf-8")
    framed.write_text(text.replace("</body>", f"{message}</script></body>"), encoding="utf-8")
    outer = page.with_name("outer.html")
    outer.write_text(
        "<!DOCTYPE html><body><script>addEventListener('message', (event) => "
        "{ document.body.dataset.widths = event.data; })</script>"
        f'<iframe width="{width}" height="900" style="border: 0" src="framed.html"></iframe>',
        encoding="utf-8",
    )
    document, console = opened(outer, tmp_path / "profile", "--window-size=1600,1000")
    assert console == ""
    assert f'data-widths="{width},{width}"' in document


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
