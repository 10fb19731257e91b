"""A whole run: exit codes, one crash among others, reports, update."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from experiments.errors import InputError, MachineryError
from experiments.gate.run import check_gates, run_gate
from experiments.gate.specification import GateSpec
from experiments.gate.summary import (
    ANNOTATION_LIMIT,
    MARKDOWN_LIMIT,
    github_annotations,
    markdown_summary,
)
from reports.junit import Verdict
from reports.record import Record

if TYPE_CHECKING:
    from tests.experiments.gate.conftest import Bench

GATE = """
[[gate]]
name = "{name}"
scene = "bench"
preset = "medium"
width = 32
height = 32
reference_spp = 512
[[gate.metric]]
kind = "noninferior"
metric = "energy_ratio"
component = "indirect"
scale = "ratio"
rel = 0.02
[[gate.metric]]
kind = "noninferior"
metric = "relmse_e2"
component = "indirect"
rel = 0.05
"""
Render = Callable[[GateSpec], tuple[Record, Path]]


@pytest.fixture
def gates_file(tmp_path: Path) -> Path:
    path = tmp_path / "gates" / "gates.toml"
    path.parent.mkdir()
    gates = "".join(GATE.format(name=name) for name in ("one", "two"))
    path.write_text(f"schema_version = 1\n{gates}", encoding="utf-8")
    return path


@pytest.fixture
def good(bench: Bench) -> Render:
    def render(gate: GateSpec) -> tuple[Record, Path]:
        return bench.record(seed=3)

    return render


@pytest.fixture
def regressed(bench: Bench) -> Render:
    def render(gate: GateSpec) -> tuple[Record, Path]:
        return bench.record(seed=4, render=bench.render * 1.05)

    return render


@pytest.fixture(autouse=True)
def _not_on_github(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)


def crash(gate: GateSpec) -> tuple[Record, Path]:
    raise RuntimeError("out of\nmemory")


def failing_first(first: Render, others: Render) -> Render:
    def render(gate: GateSpec) -> tuple[Record, Path]:
        return (first if gate.name == "one" else others)(gate)

    return render


def verdict(message: str = "why", kind: str = "noninferior", passed: bool = False) -> Verdict:
    return Verdict(
        gate="bench: relmse",
        scene="bench",
        kind=kind,
        passed=passed,
        value=0.5,
        limit="<= 0.4",
        message=message,
        seconds=0.0,
    )


def test_update_then_pass_then_fail(
    gates_file: Path, good: Render, regressed: Render, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_gate(gates_file, good) == 1
    assert f"vctgi gate {gates_file} --update --reason TEXT" in capsys.readouterr().err
    assert run_gate(gates_file, good, update_reason="first baseline") == 0
    files = sorted(path.name for path in gates_file.parent.glob("*.json"))
    assert files == ["one.medium.llvm_ad_rgb.json", "two.medium.llvm_ad_rgb.json"]
    assert run_gate(gates_file, good, mutants=True) == 0
    assert capsys.readouterr().err == ""
    before = [path.read_bytes() for path in sorted(gates_file.parent.glob("*.json"))]
    assert run_gate(gates_file, regressed) == 1
    assert "one: energy_ratio of indirect [noninferior]" in capsys.readouterr().err
    assert [path.read_bytes() for path in sorted(gates_file.parent.glob("*.json"))] == before


def test_a_crash_ends_one_gate_and_not_the_others(gates_file: Path, good: Render) -> None:
    run_gate(gates_file, good, update_reason="first baseline")
    result = check_gates(gates_file, failing_first(crash, good))
    (failed,) = [v for v in result.verdicts if not v.passed]
    assert (failed.gate, failed.kind) == ("one: render", "error")
    assert "RuntimeError: out of" in failed.message
    assert any(v.gate.startswith("two:") and v.kind == "noninferior" for v in result.verdicts)
    assert result.exit_code == 3


def test_a_proven_failure_outranks_a_crash_and_bad_input_too(
    gates_file: Path, good: Render, regressed: Render
) -> None:
    def bad_input(gate: GateSpec) -> tuple[Record, Path]:
        raise InputError("no such scene", gate.scene, "name another")

    def missing_reference(gate: GateSpec) -> tuple[Record, Path]:
        raise MachineryError("no reference", gate.scene, "render it")

    run_gate(gates_file, good, update_reason="first baseline")
    assert run_gate(gates_file, failing_first(crash, regressed)) == 1
    assert run_gate(gates_file, failing_first(bad_input, good)) == 2
    assert run_gate(gates_file, failing_first(bad_input, crash)) == 2
    assert run_gate(gates_file, failing_first(missing_reference, good)) == 3


def test_an_interrupt_is_not_swallowed(gates_file: Path) -> None:
    def interrupted(gate: GateSpec) -> tuple[Record, Path]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_gate(gates_file, interrupted)


def test_a_broken_baseline_is_bad_input(gates_file: Path, good: Render) -> None:
    run_gate(gates_file, good, update_reason="first baseline")
    (gates_file.parent / "one.medium.llvm_ad_rgb.json").write_text("{", encoding="utf-8")
    assert run_gate(gates_file, good) == 2


def test_nothing_is_rendered_for_bad_usage(gates_file: Path) -> None:
    with pytest.raises(InputError, match="no reason"):
        run_gate(gates_file, crash, update_reason=" ")
    with pytest.raises(InputError, match="cannot read the gates file"):
        run_gate(gates_file.with_name("other.toml"), crash)


def test_update_reports_what_it_refuses_and_writes_the_rest(gates_file: Path, good: Render) -> None:
    assert run_gate(gates_file, failing_first(crash, good), update_reason="why") == 3
    assert [path.name for path in gates_file.parent.glob("*.json")] == [
        "two.medium.llvm_ad_rgb.json"
    ]


def test_orders_compare_records_of_two_gates(gates_file: Path, bench: Bench) -> None:
    order = '[[order]]\nname = "finer"\nbetter = "one"\nworse = "two"\nmetric = "relmse_e2"\n'
    text = gates_file.read_text(encoding="utf-8") + order + 'component = "indirect"\n'
    gates_file.write_text(text, encoding="utf-8")

    def fine(gate: GateSpec) -> tuple[Record, Path]:
        return bench.record(seed=5, render=0.5 * (bench.render + bench.truth))

    def coarse(gate: GateSpec) -> tuple[Record, Path]:
        return bench.record(seed=6)

    def outcome(render: Render) -> list[bool]:
        verdicts = check_gates(gates_file, render).verdicts
        return [v.passed for v in verdicts if v.kind == "order"]

    assert outcome(failing_first(fine, coarse)) == [True]
    assert outcome(failing_first(coarse, fine)) == [False]
    assert outcome(failing_first(crash, fine)) == []


def test_reports_are_written(gates_file: Path, good: Render, tmp_path: Path) -> None:
    junit, markdown = tmp_path / "out" / "gate.xml", tmp_path / "out" / "gate.md"
    run_gate(gates_file, good, update_reason="first baseline")
    run_gate(gates_file, failing_first(crash, good), junit=junit, markdown=markdown)
    suite = ElementTree.parse(junit).getroot()[0]
    assert suite.attrib["failures"] == "1"
    (failure,) = suite.iter("failure")
    assert failure.attrib["type"] == "error"
    text = markdown.read_text(encoding="utf-8")
    assert "| one: render | bench | error |" in text
    assert "two" not in text


def test_a_report_that_cannot_be_written_is_named(
    gates_file: Path, good: Render, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(MachineryError, match="cannot write the report"):
        run_gate(gates_file, good, markdown=tmp_path / "file" / "gate.md")


def test_annotations_only_on_github(
    gates_file: Path,
    good: Render,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run_gate(gates_file, good)
    assert capsys.readouterr().out == ""
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    run_gate(gates_file, crash)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "::error title=one%3A render [error]::RuntimeError: out of%0Amemory"
    assert len(lines) == 2


def test_annotations_are_at_most_ten_and_count_the_rest() -> None:
    lines = github_annotations([verdict()] * 25)
    assert len(lines) == ANNOTATION_LIMIT
    assert lines[-1].endswith("16 more checks failed")
    assert len(github_annotations([verdict()] * 10)) == ANNOTATION_LIMIT
    assert github_annotations([verdict(passed=True)]) == []


def test_markdown_escapes_and_stays_under_its_limit() -> None:
    text = markdown_summary([verdict("a | b <img> `x`")], "update it")
    assert "a \\| b &lt;img> \\`x\\`" in text
    assert "`update it`" in text
    flood = markdown_summary([verdict("long " * 500)] * 2000, "update it")
    assert len(flood.encode()) <= MARKDOWN_LIMIT
    assert "more failures are in the JUnit file" in flood
    assert "0 of 1 checks failed" in markdown_summary([verdict(passed=True)], "update it")
