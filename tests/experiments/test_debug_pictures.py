"""`vctgi render --debug voxels`: what is written, what is refused, and when `--debug` is bare."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.cli import _take_debug, main
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE

SMALL = ["--resolution", "32", "--preset", "medium", "--spp", "1"]


def test_a_frame_comes_with_a_folder_of_pictures_and_a_page(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = tmp_path / "frame.exr"
    arguments = ["render", "cornell_box", "-o", str(frame), "--debug", "voxels"]
    assert main([*arguments, *SMALL, "--variant", variant]) == EXIT_DONE
    folder = tmp_path / "frame.voxels"
    written = {file.name for file in folder.iterdir()}
    level = {f"level0_{name}.png" for name in ("opacity", "albedo", "normal", "radiance")}
    assert level | {"index.html", "levels.png", "level0_coverage.png"} <= written
    assert not [name for name in written if name.startswith(".")], "nothing half-written is left"
    assert {file.name for file in tmp_path.iterdir()} == {"frame.exr", "frame.voxels"}
    lines = capsys.readouterr().out
    assert all(str(folder / name) in lines for name in written)
    assert "sampled coverage minus exact coverage" in lines
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert set(re.findall(r'src="(.{0,22})', page)) == {"data:image/png;base64,"}
    assert len(page) < 6_000_000
    walls = np.asarray(Image.open(folder / "level0_albedo.png"), dtype=int)
    # Left red, right green, as the scene is.
    assert walls[16, 2, 0] > 2 * walls[16, 2, 1]
    assert walls[16, 29, 1] > walls[16, 29, 0] + 20


def test_pictures_that_do_not_exist_are_refused_before_anything_is_rendered(
    variant: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["render", "cornell_box", "-o", "frame.exr", "--debug", "pixels"]
    assert main([*arguments, "--variant", variant]) == EXIT_BAD_INPUT
    line = capsys.readouterr().err
    assert "no debug pictures of 'pixels': --debug; use voxels" in line
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_refused(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "frame.voxels").write_text("a file", encoding="utf-8")
    arguments = ["render", "cornell_box", "-o", str(tmp_path / "frame.exr"), "--debug", "voxels"]
    assert main([*arguments, *SMALL, "--variant", variant]) == EXIT_BAD_INPUT
    assert "frame.voxels" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "kept", "is_debug"),
    [
        (["--debug", "render", "box"], ["render", "box"], True),
        (["render", "box", "--debug"], ["render", "box"], True),
        (["render", "box", "--debug", "--spp", "4"], ["render", "box", "--spp", "4"], True),
        (["render", "box", "--debug", "voxels"], ["render", "box", "--debug", "voxels"], False),
        (["render", "--debug=voxels", "box"], ["render", "--debug=voxels", "box"], False),
        (["report", "--debug", "box"], ["report", "box"], True),
        (
            ["--debug", "render", "box", "--debug", "voxels"],
            ["render", "box", "--debug", "voxels"],
            True,
        ),
    ],
)
def test_a_bare_debug_asks_for_the_traceback(
    given: list[str], kept: list[str], is_debug: bool
) -> None:
    assert _take_debug(given) == (kept, is_debug)
