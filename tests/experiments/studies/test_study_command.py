"""`vctgi study`: rows as they come, exit codes, selection, and work that survives a kill."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED
from experiments.studies.catalogue import STUDIES, StudyEntry
from experiments.studies.check import Check, Measured, RefusedError, StudyContext
from experiments.studies.ledger import Ledger
from experiments.studies.run import run_checks
from experiments.studies.table import row_line
from reports.study_record import StudyRecord, read_study
from tests.experiments.studies import small_study

MODULE = "tests.experiments.studies.small_study"


@pytest.fixture(autouse=True)
def folder(variant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder, with the small study offered and nothing measured."""
    monkeypatch.setitem(STUDIES, "small", StudyEntry(MODULE, small_study.TITLE))
    monkeypatch.chdir(tmp_path)
    small_study.measured.clear()
    return tmp_path


def run(*arguments: str) -> int:
    return main(["study", "small", "--cache", "cache", "--json", "study.json", *arguments])


def written() -> StudyRecord:
    return read_study(Path("study.json"))


def test_a_row_holds_the_number_its_limits_and_how_to_get_it() -> None:
    assert run() == EXIT_FAILED
    first = written().rows[0]
    assert (first.value, first.limit_low, first.limit_high) == (2.0, 1.5, None)
    assert first.passed
    # Two values 1 and 3: Student's t for one degree of freedom is tan(0.475 pi) = 12.706
    assert first.low == pytest.approx(2.0 - 12.7062, abs=1e-3)
    assert first.how == "vctgi study small --only mean"


def test_verdicts_follow_the_limits() -> None:
    run()
    verdicts = {row.check: row.passed for row in written().rows}
    assert verdicts == {"mean": True, "mean, odd": False, "aim": True, "broken": False}
    assert written().rows[3].value is None


def test_all_rows_passed_is_exit_code_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--only", "aim") == EXIT_DONE
    out = capsys.readouterr().out
    assert "1 of 1 passed" in out
    assert "quick" not in out


def test_a_check_that_refuses_says_why_and_is_asked_again(tmp_path: Path) -> None:
    def refuse(_context: StudyContext) -> Measured:
        raise RefusedError("the reference is too noisy")

    check = Check(name="hidden", configuration="plain", scene="none", measure=refuse)
    ledger = Ledger(tmp_path / "ledger.jsonl", "")
    context = StudyContext(quick=False, progress=lambda *_: None)
    (row,) = run_checks("small", [check], context, ledger, resume=True)
    assert (row.value, row.passed, row.refused) == (None, False, "the reference is too noisy")
    assert "REFUSED: the reference is too noisy" in row_line(row)
    assert ledger.find(check) is None


def test_a_note_outlives_a_run(tmp_path: Path) -> None:
    check = Check(
        name="bound",
        configuration="plain",
        scene="none",
        measure=lambda _: Measured(value=2.0, note="at least"),
    )
    context = StudyContext(quick=False, progress=lambda *_: None)
    for _ in range(2):
        ledger = Ledger(tmp_path / "ledger.jsonl", "")
        (row,) = run_checks("small", [check], context, ledger, resume=True)
        assert row.note == "at least"


def test_the_table_shows_failures(capsys: pytest.CaptureFixture[str]) -> None:
    run()
    out = capsys.readouterr().out
    assert "2 of 4 passed, 2 FAILED" in out
    assert any("mean, odd" in line and line.endswith("FAILED") for line in out.splitlines())


def test_only_selects_by_substring_and_a_whole_name_alone() -> None:
    run("--only", "EA")
    assert set(small_study.measured) == {"mean", "mean, odd", "shared"}
    small_study.measured.clear()
    run("--only", "mean")
    assert set(small_study.measured) == {"mean", "shared"}


def test_work_that_was_refused_is_not_done_again() -> None:
    context, tries = StudyContext(quick=True, progress=lambda _step, _share: None), []

    def refuse() -> float:
        tries.append(1)
        raise RefusedError("too noisy")

    for _ in range(2):
        with pytest.raises(RefusedError, match="too noisy"):
            context.once("picture", refuse)
    assert len(tries) == 1


def test_shared_work_is_done_once() -> None:
    run()
    assert small_study.measured["shared"] == 1


def test_quick_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    run("--quick", "--only", "mean")
    assert "quick version" in capsys.readouterr().out
    record = written()
    assert record.quick
    assert record.rows[0].value == 1.0
    assert record.rows[0].low is None
    assert record.rows[0].how == "vctgi study small --quick --only mean"


def test_resume_measures_only_what_is_missing(folder: Path) -> None:
    run("--only", "mean, odd")
    kept = folder / "cache" / "studies" / "small.jsonl"
    with kept.open("a") as file:
        file.write('{"key": "cut sh')
    small_study.measured.clear()
    run("--resume")
    assert set(small_study.measured) == {"mean", "aim", "broken", "shared"}
    assert [row.value for row in written().rows[:3]] == [2.0, 5.0, 0.5]


def test_numbers_of_another_size_are_not_resumed() -> None:
    run("--quick", "--only", "mean")
    run("--resume", "--only", "mean")
    assert written().rows[0].value == 2.0


def test_the_json_file_has_the_promised_names() -> None:
    run("--only", "aim")
    content = json.loads(Path("study.json").read_text())
    assert {"study", "quick", "rows", "machine"} <= set(content)
    assert set(content["rows"][0]) == {
        *("check", "configuration", "scene", "value", "low", "high"),
        *("limit_low", "limit_high", "goal", "passed", "refused", "note", "how"),
    }


def test_without_a_name_the_studies_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study"]) == EXIT_DONE
    assert "representation" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["study", "nothing"], "no study 'nothing'"),
        (["study", "small", "--only", "nowhere"], "no check holds 'nowhere'"),
        (["study", "small", "--variant", "scalar_rgb"], "llvm_ad_rgb"),
        (["study", "small", "--json", "."], "is a folder"),
    ],
)
def test_bad_usage_is_one_line_and_leaves_nothing(
    arguments: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == EXIT_BAD_INPUT
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("vctgi: ")]
    assert len(lines) == 1
    assert words in lines[0]
    assert not list(folder.iterdir())
    assert not small_study.measured


@pytest.mark.parametrize(
    ("content", "words"),
    [("{", "not the record"), ('{"study": "x"}', "quick"), (None, "cannot read")],
)
def test_a_broken_study_file_is_refused(content: str | None, words: str, folder: Path) -> None:
    path = folder / "study.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=words):
        read_study(path)


def test_a_row_must_agree_with_its_own_limits() -> None:
    run("--only", "mean")
    content = json.loads(Path("study.json").read_text())
    content["rows"][0]["passed"] = False
    Path("study.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match="its limits say True"):
        read_study(Path("study.json"))
