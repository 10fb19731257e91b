"""Records as a table: one row a metric, the job's parameters as columns."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_MACHINERY
from experiments.sweep.export import metric_rows, write_table
from reports.record import read_records
from tests.experiments.sweep.tiny_jobs import sweep_here, tiny_work

COUNT = 3


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "sweep"
    sweep_here(folder, tiny_work(folder, COUNT))
    return folder


def test_each_metric_of_each_record_is_a_row(swept: Path) -> None:
    records = read_records(swept / "records")
    rows = metric_rows(swept)
    assert len(rows) == sum(len(record.metrics) for record in records.values())
    assert {row["parameter.number"] for row in rows} == set(range(COUNT))
    for record in records.values():
        mine = [row for row in rows if row["record"] == record.record_id]
        found = {(row["component"], row["metric"]): row for row in mine}
        for metric in record.metrics:
            row = found[metric.component, metric.name]
            assert row["value"] == metric.value
            assert row["low"] == (None if metric.interval is None else metric.interval.low)
            assert row["scene"] == record.scene.name


def test_csv_needs_nothing(swept: Path, tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    assert main(["results", "export", str(swept), "-o", str(path)]) == EXIT_DONE
    with path.open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    rows = metric_rows(swept)
    assert [float(row["value"]) for row in read] == [row["value"] for row in rows]
    assert list(read[0]) == list(rows[0])


def test_parquet_holds_the_same(swept: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra [store] is not installed")
    path = tmp_path / "results.parquet"
    assert main(["results", "export", str(swept), "-o", str(path)]) == EXIT_DONE
    assert parquet.read_table(path).to_pylist() == metric_rows(swept)


def test_mixed_columns_have_one_type(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra [store] is not installed")
    values = [(1, "a", None), (2.5, 3, None), (None, True, None)]
    rows = [dict(zip(("number", "mixture", "empty"), row, strict=True)) for row in values]
    write_table(rows, tmp_path / "mixed.parquet")
    assert parquet.read_table(tmp_path / "mixed.parquet").to_pydict() == {
        "number": [1.0, 2.5, None],
        "mixture": ["a", "3", "true"],
        "empty": [None, None, None],
    }


def test_a_folder_of_a_report_has_a_table_too(swept: Path) -> None:
    rows = metric_rows(swept / "records")
    assert rows
    assert "parameter.number" not in rows[0]
    assert rows[0]["job"] is None


def test_parquet_without_its_extra_is_one_line(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    path = tmp_path / "results.parquet"
    assert main(["results", "export", str(swept), "-o", str(path)]) == EXIT_MACHINERY
    assert "pip install 'vctgi[store]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["export", "{swept}", "-o", "{tmp}/results.xlsx"], ".parquet or .csv"),
        (["export", "{tmp}", "-o", "{tmp}/results.csv"], "no record"),
        (["export", "{tmp}/none", "-o", "{tmp}/results.csv"], "no such folder"),
        (["page", "{tmp}"], "no record"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    swept: Path, tmp_path: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [word.format(swept=swept, tmp=tmp_path) for word in words]
    assert main(["results", *given]) == EXIT_BAD_INPUT
    assert said in capsys.readouterr().err


def test_a_page_of_the_records(tmp_path: Path) -> None:
    from reports.record import write_record
    from tests.reports.conftest import record_with

    write_record(record_with({}), tmp_path / "records")
    assert main(["results", "page", str(tmp_path)]) == EXIT_DONE
    assert "Synthetic cornell" in (tmp_path / "index.html").read_text(encoding="utf-8")
