"""What a gates file may say, and what each fault in it is called."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.errors import InputError
from experiments.gate.gates_file import load_gates
from experiments.gate.specification import NonInferior

GOOD = """
schema_version = 1

[[gate]]
name = "bench"
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

[[gate.budget]]
stage = "trace"
rel = 0.5
"""


def gates_file(folder: Path, text: str) -> Path:
    path = folder / "gates.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_good_file_gives_its_gates(tmp_path: Path) -> None:
    content = load_gates(gates_file(tmp_path, GOOD))
    (gate,) = content.gates
    assert content.baselines == "."
    assert isinstance(gate.metrics[0], NonInferior)
    assert gate.budgets[0].stage == "trace"


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("rel = 0.05", "rell = 0.05", r"gate\[0\]\.metric\[0\]\.noninferior\.rell: unknown key"),
        ("schema_version = 1", "schema_version = 2", "schema_version: Input should be 1"),
        ("width = 32", 'width = "32"', r"gate\[0\]\.width: .*integer"),
        ('kind = "noninferior"', 'kind = "better"', r"gate\[0\]\.metric\[0\]: .*'better'"),
        ("rel = 0.05", "rel = 0.1", "as wide as the effect of the weakest mutant"),
        ("rel = 0.05", "rel = 0.2\neffect = 0.3", "effect_from must say"),
        ("rel = 0.05", "rel = 0.05\neffect_abs = 0.3", "effect_from must say"),
        ("rel = 0.05", 'effect = 0.3\neffect_abs = 1.0\neffect_from = "x"', "not both"),
        ("rel = 0.5", "rel = 1.0", r"budget\[0\]\.rel: .*less than 1"),
        ('name = "bench"', 'name = "../bench"', r"gate\[0\]\.name"),
        ("rel = 0.05", "rel = nan", r"rel: .*finite"),
        ("schema_version = 1", "schema_version =", "not TOML"),
    ],
)
def test_a_fault_is_named_with_its_key(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    assert before in GOOD
    with pytest.raises(InputError, match=message):
        load_gates(gates_file(tmp_path, GOOD.replace(before, after, 1)))


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read the gates file"):
        load_gates(tmp_path / "none.toml")


def test_a_measured_effect_allows_a_wider_tolerance(tmp_path: Path) -> None:
    wider = 'rel = 0.2\neffect = 0.3\neffect_from = "step ratio x 4: vctgi compare ..."'
    content = load_gates(gates_file(tmp_path, GOOD.replace("rel = 0.05", wider, 1)))
    assert content.gates[0].metrics[0].kind == "noninferior"


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("low = 0.5", "needs cap"),
        ('scale = "ratio"\nlow = 0.5', "needs high and low"),
        ('scale = "ratio"\nlow = 1.5\nhigh = 0.5', "0 < low < high"),
        ('scale = "similarity"\ncap = 0.5', "needs low"),
    ],
)
def test_an_absolute_gate_needs_the_limits_of_its_scale(
    tmp_path: Path, keys: str, message: str
) -> None:
    text = GOOD.replace('"noninferior"', '"absolute"').replace("rel = 0.05", keys, 1)
    with pytest.raises(InputError, match=message):
        load_gates(gates_file(tmp_path, text))


def test_names_are_unique_and_orders_name_gates(tmp_path: Path) -> None:
    gate = GOOD.split("schema_version = 1")[1]
    with pytest.raises(InputError, match="'bench' is given more than once"):
        load_gates(gates_file(tmp_path, GOOD + gate))
    order = '[[order]]\nname = "finer"\nbetter = "bench"\nworse = "x"\nmetric = "mse"\n'
    with pytest.raises(InputError, match="must name two different gates"):
        load_gates(gates_file(tmp_path, GOOD + order + 'component = "indirect"\n'))


def test_a_gate_lists_a_number_once_per_kind(tmp_path: Path) -> None:
    metric = GOOD[GOOD.index("[[gate.metric]]") : GOOD.index("[[gate.budget]]")]
    with pytest.raises(InputError, match="noninferior relmse_e2 of indirect more than once"):
        load_gates(gates_file(tmp_path, GOOD + metric))
