"""Gates that render twice, hold numbers bit for bit, bound memory, and are chosen by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from experiments.cli import main
from experiments.errors import InputError
from experiments.gate.budget import check_memory
from experiments.gate.gates_file import load_gates
from experiments.gate.run import check_gates, run_gate
from experiments.gate.specification import GateSpec, Memory
from reports.record import Record
from tests.experiments.gate.test_mutants import COST
from tests.experiments.gate.test_study_gates import Study, no_record

if TYPE_CHECKING:
    from tests.experiments.gate.conftest import Bench

TWICE = """
schema_version = 1
[[gate]]
name = "bench"
scene = "bench"
preset = "medium"
width = 32
height = 32
reference_spp = 512
deterministic = true
[[gate.metric]]
kind = "noninferior"
metric = "relmse_e2"
component = "indirect"
rel = 0.05
"""

COUNTED = """
schema_version = 1
[[study]]
name = "shifted"
study = "banding"
[[study.check]]
kind = "exact"
check = "values that moved"
mutant = "values that moved, half a voxel"
"""

ORDER = """
[[gate]]
name = "other"
scene = "bench"
preset = "medium"
width = 32
height = 32
reference_spp = 512
[[gate.metric]]
kind = "noninferior"
metric = "relmse_e2"
component = "indirect"
rel = 0.05
[[order]]
name = "finer"
better = "bench"
worse = "other"
metric = "relmse_e2"
component = "indirect"
"""


@pytest.fixture
def gates_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    path = tmp_path / "gates.toml"
    path.write_text(TWICE, encoding="utf-8")
    return path


def test_the_same_pictures_twice_pass_and_rounding_fails(gates_file: Path, bench: Bench) -> None:
    factor = 1.0

    def render(gate: GateSpec) -> tuple[Record, Path]:
        nonlocal factor
        found = bench.record(seed=3, render=bench.render * factor)
        factor = last
        return found

    last = 1.0
    assert run_gate(gates_file, render, update_reason="first") == 0
    result = check_gates(gates_file, render, mutants=True)
    assert result.exit_code == 0
    assert "bench: one value moved by rounding" in {v.gate for v in result.verdicts}
    last = 1.0 + 1e-6
    (failed,) = [v for v in check_gates(gates_file, render).verdicts if not v.passed]
    assert (failed.gate, failed.kind) == ("bench: rendered twice", "exact")
    assert "not the same twice: error: " in failed.message
    # A baseline is not made from what is not deterministic, either
    factor = 1.0
    assert run_gate(gates_file, render, update_reason="second") == 1


def test_a_number_is_held_bit_for_bit(gates_file: Path) -> None:
    gates_file.write_text(COUNTED, encoding="utf-8")
    numbers = {"values that moved": 0.0, "values that moved, half a voxel": 512.0}
    assert run_gate(gates_file, no_record, Study(**numbers), update_reason="first") == 0
    result = check_gates(gates_file, no_record, Study(**numbers), mutants=True)
    assert [v.gate for v in result.verdicts if not v.passed] == []
    # A NaN, a configuration, the next float and the planted fault
    assert sum(v.kind == "mutant" for v in result.verdicts) == 4
    numbers["values that moved"] = 1e-300
    (failed,) = [
        v for v in check_gates(gates_file, no_record, Study(**numbers)).verdicts if not v.passed
    ]
    assert failed.kind == "exact"


def test_a_fault_that_moves_no_number_makes_no_baseline(gates_file: Path) -> None:
    gates_file.write_text(COUNTED, encoding="utf-8")
    same = Study(**dict.fromkeys(("values that moved", "values that moved, half a voxel"), 0.0))
    assert run_gate(gates_file, no_record, same, update_reason="first") == 2


def test_voxels_that_grow_fail(bench: Bench) -> None:
    gate = bench.gate(memory={"rel": 0.1})
    record = bench.record(seed=2)[0].model_copy(update={"cost": COST})
    baseline = bench.baseline(gate, record)
    memory = Memory(rel=0.1)
    for size, passed in ((900, True), (1100, True), (1101, False)):
        grown = record.model_copy(update={"cost": COST.model_copy(update={"voxel_bytes": size})})
        assert check_memory(memory, grown, baseline).passed == passed
    before = baseline.model_copy(update={"voxel_bytes": None})
    assert not check_memory(memory, record, before).passed
    with pytest.raises(InputError, match="does not say how much memory"):
        check_memory(memory, bench.record(seed=2)[0], baseline)


def test_orders_of_records_have_a_mutant(gates_file: Path, bench: Bench) -> None:
    gates_file.write_text(TWICE + ORDER, encoding="utf-8")

    def render(gate: GateSpec) -> tuple[Record, Path]:
        middle = 0.5 * (bench.render + bench.truth)
        return bench.record(seed=5, render=middle if gate.name == "bench" else bench.render)

    assert run_gate(gates_file, render, update_reason="first") == 0
    result = check_gates(gates_file, render, mutants=True)
    assert [v.gate for v in result.verdicts if not v.passed] == []
    assert "bench: order finer swapped" in {v.gate for v in result.verdicts}


def test_only_gates_of_a_name_are_checked(gates_file: Path) -> None:
    gates_file.write_text(TWICE + ORDER, encoding="utf-8")
    content = load_gates(gates_file)
    assert [gate.name for gate in content.only(["other"]).gates] == ["other"]
    assert content.only(["other"]).orders == ()
    assert content.only(["other", "bench"]).orders == content.orders
    with pytest.raises(InputError, match="no gate 'nine'"):
        content.only(["nine"])


@pytest.mark.parametrize(
    ("before", "after", "line"),
    [
        ('scene = "bench"', 'scene = "bench"\nscnee = 1', "gate[0].scnee: unknown key"),
        ('preset = "medium"', 'preset = "mediun"', "no preset 'mediun'"),
        ("schema_version = 1", "schema_version = ", "not TOML"),
        ('scene = "bench"', 'scene = "none.xml"', "none.xml"),
    ],
)
def test_a_bad_file_is_one_line_and_renders_nothing(
    gates_file: Path, before: str, after: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = TWICE.replace(before, after, 1)
    gates_file.write_text(text, encoding="utf-8")
    output = gates_file.parent / "out"
    assert main(["gate", str(gates_file), "--output", str(output)]) == 2
    error = capsys.readouterr().err
    assert line in error.replace("gate.0", "gate[0]")
    assert len(error.replace("1 gates: could not be judged\n", "").strip().splitlines()) == 1
    assert not list(output.glob("**/*.json"))


def test_a_renamed_check_is_one_line_before_anything_is_measured(
    gates_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gates_file.write_text(COUNTED + TWICE.split("1\n", 1)[1], encoding="utf-8")
    junit = gates_file.parent / "out" / "gate.xml"
    common = ["gate", str(gates_file), "--output", str(gates_file.parent / "out")]
    assert main([*common, "--junit", str(junit)]) == 2
    error = capsys.readouterr().err
    assert "study banding has no check 'values that moved'" in error
    assert len(error.strip().splitlines()) == 1
    assert not junit.exists()
