"""Study "light": its list of checks, and a few of its numbers in the quick version."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.cli import main
from experiments.errors import EXIT_DONE
from experiments.studies.catalogue import checks_of, find_study
from reports.study_record import read_study

pytestmark = pytest.mark.usefixtures("variant")


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("light"))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


@pytest.mark.parametrize("only", ["map power, point", "map power, directional", "slit", "300"])
def test_numbers_keep_to_their_limits(only: str, tmp_path: Path) -> None:
    file = tmp_path / "study.json"
    words = ["study", "light", "--quick", "--only", only, "--json", str(file)]
    assert main([*words, "--cache", str(tmp_path)]) == EXIT_DONE
    assert all(row.passed for row in read_study(file).rows)
