"""Headless Chromium: a page as a reader opens it, from a file."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="headless Chromium is missing: install the package chromium"
)

TIME_LIMIT_S = 120.0


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
    # The clock of the page may run out while other processes decode its images on a busy machine.
    for longer in ((), ("--virtual-time-budget=100000",)):
        document, console = opened(copy, profile, *longer, *flags)
        assert console == ""
        found = re.search(r'<body data-probe="([^"]*)"', document)
        if found is not None:
            break
    assert found is not None, "the probe did not finish"
    return json.loads(found.group(1).replace("&quot;", '"'))


def content_width(page: Path, profile: Path, width: int) -> int:
    """Width that a page takes in a window of this width; the console must be silent."""
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
    document, console = opened(outer, profile, "--window-size=1600,1000")
    assert console == ""
    found = re.search(r'data-widths="(\d+),(\d+)"', document)
    assert found is not None, "the page did not say how wide it is"
    assert int(found.group(2)) == width
    return int(found.group(1))


PRINT_WIDTH = 718
"""Pixels between the margins of a sheet of A4."""


def left_on_paper(paper: Path, profile: Path) -> tuple[int, int]:
    """How many parts of a `printed` page are folded away, and how many of its controls show."""
    script = """
      const folded = document.querySelectorAll("details:not(.record):not([open])");
      const controls = [...document.querySelectorAll(".controls, .families, .readout")];
      return [folded.length, controls.filter((each) => each.checkVisibility()).length];
    """
    folded, controls = probed(paper, profile, script)
    return folded, controls


def printed(page: Path) -> Path:
    """Write a copy of a page that looks on the screen as the page does on paper."""
    text = page.read_text(encoding="utf-8")
    assert text.count("@media print"), "the page says how it prints"
    shown = text.replace("@media print", "@media screen")
    event = "<script>dispatchEvent(new Event('beforeprint'))</script></body>"
    copy = page.with_name("printed.html")
    copy.write_text(shown.replace("</body>", event), encoding="utf-8")
    return copy
