"""The page of studies: complete, escaped, offline, and the same for the same records."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from reports.study_markdown import study_summary
from reports.study_page import study_files, study_page, write_study_page
from reports.study_record import read_study
from tests.reports import study_records as synthetic
from tests.reports.chromium import (
    PRINT_WIDTH,
    content_width,
    left_on_paper,
    needs_chromium,
    opened,
    printed,
    probed,
)

MOST_BYTES = 20e6

AWKWARD = "rooms <b>& \"doors\"</b> 'x' {{ 7*7 }} </script>"


@pytest.fixture
def page(tmp_path: Path) -> Path:
    failing = [synthetic.row("fine", 0.1, 1.0), synthetic.row(AWKWARD, 2.0, 1.0)]
    synthetic.written(tmp_path)
    synthetic.written(tmp_path, "attribution", study="attribution", rows=failing)
    return write_study_page(tmp_path)


def test_the_page_holds_question_numbers_figures_and_definitions(tmp_path: Path) -> None:
    text = study_page([synthetic.written(tmp_path)])
    for words in (
        "How much came through?", "vctgi study leaking", "0123456789ab", "dark / lit",
        "metrics/leaking.py", "[0.0100 to 0.0300]", "None of 2 failed", "Leaks", "of the light",
        "interaction that no order shares out 0.0125", "left over with all exact 0.0100",
    ):  # fmt: skip
        assert words in text
    assert text.count("<svg") == 2
    assert text.count("data:image/png") == 3
    assert len(text) < MOST_BYTES


def test_the_same_records_give_the_same_characters(tmp_path: Path) -> None:
    path = synthetic.written(tmp_path)
    assert study_page([path]) == study_page([path])


def test_nothing_is_loaded_and_names_are_escaped(tmp_path: Path) -> None:
    rows = [synthetic.row(AWKWARD, 2.0, 1.0, configuration=AWKWARD)]
    figures = [synthetic.curve(AWKWARD, caption=AWKWARD)]
    text = study_page([synthetic.written(tmp_path, rows=rows, figures=figures, question=AWKWARD)])
    assert "<b>&" not in text
    assert "&lt;b&gt;" in text
    assert text.count("</script>") == 1
    assert not re.search(r'(?:src|href)="(?!data:|#)', text)
    assert 'x="http' not in text


def test_tables_stand_on_the_page_and_in_the_summary(tmp_path: Path) -> None:
    path = synthetic.written(tmp_path)
    text = study_page([path])
    assert "Side by side" in text
    assert "cones &lt;i&gt;&amp;" in text
    assert "[0.2500 to 0.7500]" in text
    lines = study_summary([path]).splitlines()
    assert "| by | slope | x\\|y |" in lines
    assert "| cones \\<i\\>\\& | 0.5000 (0.2500 to 0.7500) | \N{EN DASH} |" in lines


def test_what_failed_comes_first(tmp_path: Path) -> None:
    rows = [synthetic.row("good", 0.1, 1.0), synthetic.row("bad", 2.0, 1.0)]
    text = study_page([synthetic.written(tmp_path, rows=rows)])
    assert "1 of 2 failed" in text
    numbers = text[text.index("All numbers") :]
    assert numbers.index(">bad") < numbers.index(">good")
    found = text[text.index("What was found") : text.index("All numbers")]
    assert found.index(">bad") < found.index(">good")


def test_a_number_that_is_not_finite_is_shown_as_failed(tmp_path: Path) -> None:
    text = study_page([synthetic.written(tmp_path, rows=[synthetic.row("broken", None)])])
    assert "not finite" in text
    assert "1 of 1 failed" in text


def test_a_number_that_was_refused_says_why(tmp_path: Path) -> None:
    rows = [synthetic.row("hidden", None, refused="the reference is <noisy>")]
    text = study_page([synthetic.written(tmp_path, rows=rows)])
    assert "the reference is &lt;noisy&gt;" in text
    assert "1 of 1 refused" in text
    assert "1 of 1 failed" not in text


def test_a_record_of_before_there_were_figures_has_a_page(tmp_path: Path) -> None:
    content = json.loads(synthetic.written(tmp_path).read_text())
    for name in ("question", "code", "headlines", "figures", "definitions"):
        del content[name]
    path = tmp_path / "old.json"
    path.write_text(json.dumps(content))
    assert read_study(path).figures == []
    assert "vctgi study leaking" in study_page([path])


def test_other_json_in_the_folder_is_left_alone(tmp_path: Path) -> None:
    path = synthetic.written(tmp_path)
    (tmp_path / "other.json").write_text('{"rows": []}')
    (tmp_path / "cut.json").write_text("{")
    assert study_files(tmp_path) == [path]


def test_studies_stand_in_the_order_of_the_artefacts(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.index(">Leaking</a>") < text.index(">Attribution</a>")


def test_an_altered_or_missing_picture_is_refused(tmp_path: Path) -> None:
    path = synthetic.written(tmp_path)
    file = tmp_path / "leaking" / "map.exr"
    file.write_bytes(file.read_bytes() + b"x")
    with pytest.raises(ValueError, match=r"image 'map' was altered.*vctgi study leaking"):
        study_page([path])
    file.unlink()
    with pytest.raises(ValueError, match="is missing"):
        study_page([path])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"figures": [synthetic.curve(), synthetic.curve()]}, "figures of one name: rooms-curve"),
        (
            {"figures": [synthetic.table().model_dump() | {"columns": ["slope"]}]},
            r"line 'cones <i>&' has 2 cells for 1 columns",
        ),
        ({"figures": [{"kind": "cake", "group": "g", "title": "t"}]}, "does not match any"),
    ],
)
def test_a_record_with_illegal_figures_is_refused(changes: object, words: str) -> None:
    assert isinstance(changes, dict)
    with pytest.raises(ValueError, match=words):
        synthetic.record(**changes)


def test_no_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no record given"):
        write_study_page(tmp_path)


@needs_chromium
def test_the_page_opens_without_a_word_on_the_console(page: Path, tmp_path: Path) -> None:
    document, console = opened(page, tmp_path / "profile")
    assert console == ""
    assert '<html lang="en" class="js">' in document
    script = """
      document.querySelector(".enlarge").click();
      const box = document.getElementById("lightbox");
      await box.querySelector("img").decode();
      const regions = [...document.querySelectorAll(".scroll, figure.chart")];
      return [box.open, regions.length > 0, regions.every((each) => each.tabIndex === 0)];
    """
    assert probed(page, tmp_path / "profile", script) == [True, True, True]


@needs_chromium
@pytest.mark.parametrize("width", [400, 1200])
def test_nothing_is_wider_than_the_window(page: Path, tmp_path: Path, width: int) -> None:
    assert content_width(page, tmp_path / "profile", width) == width


@needs_chromium
def test_on_paper_nothing_is_cut_off_or_folded_away(page: Path, tmp_path: Path) -> None:
    paper = printed(page)
    assert content_width(paper, tmp_path / "profile", PRINT_WIDTH) == PRINT_WIDTH
    assert left_on_paper(paper, tmp_path / "profile") == (0, 0)
