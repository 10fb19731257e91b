"""Processes that run the same code as this one, wherever it lies and whatever their folder is."""

from __future__ import annotations

import os

from experiments.sweep.code_version import SOURCE_FOLDER


def same_code_environment() -> dict[str, str]:
    """Return the environment for a process that imports the packages of this one."""
    others = os.environ.get("PYTHONPATH")
    paths = [str(SOURCE_FOLDER), *([others] if others else [])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
