"""Gates on numbers of studies: baselines, mutants, orders, refusals, and what a file may say."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from experiments.cli import main
from experiments.errors import InputError
from experiments.gate.gates_file import load_gates
from experiments.gate.run import check_gates, run_gate
from experiments.gate.specification import GateSpec
from experiments.gate.study_specification import StudyGate
from experiments.studies.catalogue import STUDIES, StudyEntry
from reports.record import Machine, Record
from reports.study_record import StudyRecord, StudyRow

GATES = """
schema_version = 1
[[study]]
name = "waves"
study = "banding"
[[study.check]]
kind = "noninferior"
check = "bands"
mutant = "bands, steps times 4"
rel = 0.05
noise = 0.01
[[study.check]]
kind = "absolute"
check = "energy"
mutant = "energy times 1.05"
scale = "ratio"
low = 0.97
high = 1.03
noise = 0.005
effect = 0.05
[[study.order]]
name = "bands_fall_with_the_step"
better = "bands"
worse = "bands, steps times 2"
"""

SMALL = """
schema_version = 1
[[study]]
name = "small"
study = "small"
[[study.check]]
kind = "noninferior"
check = "aim"
mutant = "mean"
rel = 0.05
noise = 0.01
"""

NUMBERS = {
    "bands": 0.01,
    "bands, steps times 2": 0.03,
    "bands, steps times 4": 0.1,
    "energy": 1.0,
    "energy times 1.05": 1.05,
}


def no_record(gate: GateSpec) -> tuple[Record, Path]:
    raise AssertionError(f"nothing asks for {gate.name}")


class Study:
    """Measures known numbers; remembers what was asked for."""

    def __init__(self, **changes: Any) -> None:
        self.numbers: dict[str, float | None] = {**NUMBERS, **changes}
        self.asked: list[str] = []
        self.refused: dict[str, str] = {}
        self.configuration = "N = 64"

    def __call__(self, gate: StudyGate, names: Sequence[str]) -> StudyRecord:
        self.asked = list(names)
        return StudyRecord(
            study=gate.study,
            quick=gate.quick,
            created=datetime(2026, 1, 31, tzinfo=UTC),
            command="vctgi study banding",
            rows=[self._row(name) for name in names],
            machine=MACHINE,
        )

    def _row(self, name: str) -> StudyRow:
        value = None if name in self.refused else self.numbers[name]
        return StudyRow(
            check=name,
            configuration=self.configuration,
            scene="floor",
            value=value,
            low=None if value is None else 0.8 * value,
            high=None if value is None else 1.2 * value,
            goal=1.0 if "energy" in name else 0.0,
            passed=value is not None,
            refused=self.refused.get(name, ""),
            how="vctgi study banding",
        )


MACHINE = Machine(
    backend="llvm_ad_rgb",
    device="cpu",
    processor="bench processor",
    core_count=2,
    memory_gib=8.0,
    system="Linux",
    python="3.11.2",
    versions={"mitsuba": "3.9.1"},
    commit="0" * 40,
    is_dirty=False,
)


@pytest.fixture
def gates_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    path = tmp_path / "gates.toml"
    path.write_text(GATES, encoding="utf-8")
    return path


@pytest.fixture
def reviewed(gates_file: Path) -> Path:
    """Hand out gates whose baseline is there."""
    assert run_gate(gates_file, no_record, Study(), update_reason="first") == 0
    return gates_file


def failures(path: Path, study: Study, *, mutants: bool = False) -> list[tuple[str, str]]:
    result = check_gates(path, no_record, study, mutants=mutants)
    return [(v.gate.removeprefix("waves: "), v.kind) for v in result.verdicts if not v.passed]


def test_update_then_pass_with_every_mutant_caught(gates_file: Path) -> None:
    study = Study()
    assert run_gate(gates_file, no_record, study) == 1
    assert "bands, steps times 4" not in study.asked
    assert run_gate(gates_file, no_record, study, update_reason="first") == 0
    assert (gates_file.parent / "waves.study.llvm_ad_rgb.json").is_file()
    result = check_gates(gates_file, no_record, study, mutants=True)
    assert result.exit_code == 0
    # A NaN, a configuration; a number moved up, a ratio up and down; two faults; an order
    assert sum(v.kind == "mutant" for v in result.verdicts) == 2 + 3 + 2 + 1
    assert study.asked == [
        *list(NUMBERS)[:1],
        "energy",
        "bands, steps times 2",
        *list(NUMBERS)[2::2],
    ]


@pytest.mark.parametrize(
    ("changes", "failed"),
    [
        ({"bands": 0.0109}, [("bands", "noninferior")]),
        ({"bands": 0.005}, []),
        ({"energy": 1.05}, [("energy", "absolute")]),
        ({"energy": 1.028}, [("energy", "absolute")]),
        ({"bands, steps times 2": 0.005}, [("order bands_fall_with_the_step", "order")]),
        ({"bands, steps times 2": 0.011}, [("order bands_fall_with_the_step", "error")]),
        ({"bands": None}, [("numbers", "finite")]),
    ],
)
def test_a_fault_fails_what_names_it(
    reviewed: Path, changes: dict[str, float | None], failed: list[tuple[str, str]]
) -> None:
    assert failures(reviewed, Study(**changes)) == failed


def test_another_configuration_is_not_compared(reviewed: Path) -> None:
    study = Study()
    study.configuration = "N = 32"
    assert failures(reviewed, study) == [("bands", "exact"), ("energy", "exact")]


def test_a_number_below_the_noise_is_exit_code_3(
    reviewed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = Study()
    study.refused = {"energy": "the reference is too noisy to compare"}
    assert run_gate(reviewed, no_record, study) == 3
    assert "the reference is too noisy to compare" in capsys.readouterr().err


def test_a_fault_that_the_gate_stops_seeing_fails_the_mutants(reviewed: Path) -> None:
    found = failures(reviewed, Study(**{"bands, steps times 4": 0.0101}), mutants=True)
    assert found == [("bands with its fault: bands, steps times 4 [noninferior]", "mutant")]


def test_a_tolerance_wider_than_its_fault_makes_no_baseline(
    gates_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weak = Study(**{"bands, steps times 4": 0.0103})
    assert run_gate(gates_file, no_record, weak, update_reason="first") == 2
    assert "which keeps to the limit" in capsys.readouterr().err
    assert not list(gates_file.parent.glob("*.json"))


def test_a_crash_is_the_machinery(reviewed: Path) -> None:
    def crash(gate: StudyGate, names: Sequence[str]) -> StudyRecord:
        raise RuntimeError("out of memory")

    assert run_gate(reviewed, no_record, crash) == 3


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('mutant = "bands, steps times 4"\n', "", "mutant: Field required"),
        ('mutant = "bands, steps times 4"', 'mutant = "bands"', "must be another check"),
        ('check = "bands"', 'check = "x, audit, leak"', "missing_light beside it"),
        ("rel = 0.05", "rel = 0.1", "as wide as the effect of the weakest mutant"),
        ('worse = "bands, steps times 2"', 'worse = "bands"', "two different checks"),
        ('study = "banding"', 'study = "banding"\nquik = true', "quik: unknown key"),
    ],
)
def test_a_fault_of_the_file_is_named(
    gates_file: Path, before: str, after: str, message: str
) -> None:
    assert before in GATES
    gates_file.write_text(GATES.replace(before, after, 1), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_gates(gates_file)


def test_a_file_without_gates_is_refused(gates_file: Path) -> None:
    gates_file.write_text("schema_version = 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"no \[\[gate\]\] and no \[\[study\]\]"):
        load_gates(gates_file)


def test_a_study_is_measured_by_its_command(
    variant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(STUDIES, "small", StudyEntry("tests.experiments.studies.small_study", "?"))
    path = tmp_path / "gates.toml"
    path.write_text(SMALL, encoding="utf-8")
    common = ["gate", str(path), "--output", str(tmp_path), "--cache", str(tmp_path)]
    assert main([*common, "--update", "--reason", "first"]) == 0
    assert main([*common, "--mutants"]) == 0
    path.write_text(SMALL.replace('"aim"', '"no such"'), encoding="utf-8")
    assert main(common) == 2
