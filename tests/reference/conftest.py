"""The variant that these tests run in."""

from __future__ import annotations

import mitsuba as mi
import pytest


@pytest.fixture(autouse=True)
def _set_variant(variant: str) -> None:
    """Set the module's variant again for each test: one of them leaves another behind."""
    mi.set_variant(variant)
