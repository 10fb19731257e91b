"""The built-in scenes by name, with what each is for."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from experiments.scenes.cornell_box import cornell_box
from experiments.scenes.corridor import corridor
from experiments.scenes.glossy_floor import glossy_floor
from experiments.scenes.open_sky import open_sky
from experiments.scenes.sealed_rooms import sealed_rooms
from experiments.scenes.small_light import small_light


@dataclass(frozen=True, kw_only=True)
class SceneEntry:
    """A built-in scene."""

    name: str
    """What the command line calls it."""
    title: str
    """Heading in a report."""
    purpose: str
    """What the scene tests: the prose of the function's docstring."""
    function: Callable[..., dict[str, Any]]
    """Returns the Mitsuba dict; its keyword arguments are the scene's parameters."""


def describe(function: Callable[..., object]) -> str:
    """Prose of a docstring, as one line: what stands before the first numpydoc section.

    Returns an empty string for a function without a docstring.
    """
    prose = re.split(r"\n\s*\w[\w ]*\n\s*-{3,}", inspect.getdoc(function) or "")[0]
    return " ".join(prose.split())


def _entry(function: Callable[..., dict[str, Any]], title: str) -> SceneEntry:
    return SceneEntry(
        name=function.__name__, title=title, purpose=describe(function), function=function
    )


BUILT_IN: dict[str, SceneEntry] = {
    entry.name: entry
    for entry in (
        _entry(cornell_box, "Cornell box"),
        _entry(sealed_rooms, "Sealed rooms"),
        _entry(glossy_floor, "Glossy floor"),
        _entry(small_light, "Small light"),
        _entry(open_sky, "Open sky"),
        _entry(corridor, "Corridor of rooms"),
    )
}
"""Built-in scenes by name, in the order in which a report shows them."""
