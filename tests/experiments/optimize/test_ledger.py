"""Evaluations on disk: found again, to the last bit, whatever a kill left behind."""

from __future__ import annotations

from pathlib import Path

from experiments.optimize.ledger import EvaluationLedger

ROW = {"error": 1.0 / 3.0, "gradient": [0.1, 1e-300]}


def test_what_was_kept_is_found_to_the_last_bit(tmp_path: Path) -> None:
    file = tmp_path / "folder" / "fit.jsonl"
    EvaluationLedger(file, "code").add(ROW, "scene", "config", "0")
    again = EvaluationLedger(file, "code")
    assert again.find("scene", "config", "0") == ROW
    assert again.reused_count == 1
    assert again.find("scene", "config", "1") is None


def test_other_code_finds_nothing(tmp_path: Path) -> None:
    EvaluationLedger(tmp_path / "fit.jsonl", "code").add(ROW, "scene")
    assert EvaluationLedger(tmp_path / "fit.jsonl", "other code").find("scene") is None


def test_half_a_line_of_a_kill_costs_only_itself(tmp_path: Path) -> None:
    file = tmp_path / "fit.jsonl"
    ledger = EvaluationLedger(file, "code")
    ledger.add(ROW, "first")
    ledger.add(ROW, "second")
    file.write_bytes(file.read_bytes()[:-20])
    after = EvaluationLedger(file, "code")
    assert after.find("first") == ROW
    assert after.find("second") is None
    after.add(ROW, "third")
    assert EvaluationLedger(file, "code").find("third") == ROW
