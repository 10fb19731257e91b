"""Rules about the files themselves that no other tool holds."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
PACKAGES = ("vctgi", "reference", "metrics", "experiments", "reports", "tests")

MOST_LINES = 400
"""A longer module holds a second idea."""


def relative(path: Path) -> str:
    return str(path.relative_to(REPOSITORY))


MODULES = sorted(path for package in PACKAGES for path in (REPOSITORY / package).rglob("*.py"))
DOCUMENTS = sorted(
    [
        *REPOSITORY.glob("*.md"),
        *(path for folder in (*PACKAGES, "docs") for path in (REPOSITORY / folder).rglob("*.md")),
    ]
)


@pytest.mark.parametrize("module", MODULES, ids=relative)
def test_a_module_holds_one_idea(module: Path) -> None:
    assert len(module.read_text().splitlines()) <= MOST_LINES


@pytest.mark.parametrize("module", MODULES, ids=relative)
def test_no_annotation_is_evaluated_at_import(module: Path) -> None:
    # An evaluated `mi.Float` fails until a variant is set
    tree = ast.parse(module.read_text())
    futures = [
        name.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and node.module == "__future__"
        for name in node.names
    ]
    assert "annotations" in futures or not tree.body


@pytest.mark.parametrize("document", DOCUMENTS, ids=relative)
def test_relative_links_lead_somewhere(document: Path) -> None:
    prose = re.sub(r"```.*?```", "", document.read_text(), flags=re.DOTALL)
    targets = re.findall(r"\]\(([^)\s]+)\)", prose)
    files = [t.split("#")[0] for t in targets if not re.match(r"[a-z]+:|#", t)]
    assert [file for file in files if not (document.parent / file).exists()] == []
