"""Study "peers": its list of checks, and a few of its numbers in the quick version."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.cli import main
from experiments.errors import EXIT_DONE
from experiments.studies.catalogue import checks_of, find_study
from reports.study_record import read_study

pytestmark = pytest.mark.usefixtures("variant")


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("peers"))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


@pytest.mark.parametrize("only", ["wall, ultra", "wall, ogre_iso, leak", "1 .. 64 cones"])
def test_numbers_keep_to_their_limits(only: str, tmp_path: Path) -> None:
    file = tmp_path / "study.json"
    words = ["study", "peers", "--quick", "--only", only, "--json", str(file)]
    assert main([*words, "--cache", str(tmp_path)]) == EXIT_DONE
    assert all(row.passed for row in read_study(file).rows)


@pytest.mark.slow
def test_the_whole_quick_study_passes(tmp_path: Path) -> None:
    assert main(["study", "peers", "--quick", "--cache", str(tmp_path)]) == EXIT_DONE
