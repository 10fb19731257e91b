"""Accuracy of the representation alone."""

from __future__ import annotations

from experiments.studies.check import Check


def checks() -> list[Check]:
    """Return the checks of accuracy."""
    return []
