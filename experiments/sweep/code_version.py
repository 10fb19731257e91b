"""A hash of the code that a run's numbers come from."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

SOURCE_FOLDER = Path(__file__).resolve().parents[2]
"""Where the packages lie."""

COUNTED = (
    "vctgi",
    "reference",
    "metrics",
    "experiments/scenes",
    "experiments/run.py",
    "experiments/record.py",
    "experiments/timing.py",
    "reports/schema.py",
)
"""Packages and modules that decide what is in a record."""

LIBRARIES = ("mitsuba", "drjit", "numpy")


@cache
def code_version() -> str:
    """Return 64 hexadecimal digits that change with the sources and the libraries below them."""
    digest = hashlib.sha256()
    for name in COUNTED:
        place = SOURCE_FOLDER / name
        paths = sorted(place.rglob("*.py")) if place.is_dir() else [place]
        for path in paths:
            digest.update(f"{path.relative_to(SOURCE_FOLDER).as_posix()}\n".encode())
            digest.update(path.read_bytes())
    for library in LIBRARIES:
        digest.update(f"\n{library} {version(library)}".encode())
    return digest.hexdigest()
