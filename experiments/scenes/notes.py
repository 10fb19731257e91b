"""Who made a scene: read from the text files beside it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_TEXT_FILES = ("README.md", "LICENSE.txt")
_SENTENCE_END = re.compile(r"(?<=\))\.?\s+(?=[A-Z])|\.\s+(?=[A-Z])")
"""A licence line may go on with remarks; the credit is its first sentence."""


@dataclass(frozen=True, kw_only=True)
class SceneNotes:
    """What the text beside a scene says; empty strings where it says nothing."""

    title: str = ""
    """First heading."""
    purpose: str = ""
    """The section "What it exercises"."""
    credit: str = ""
    """`Author, Licence`."""


def read_notes(folder: Path) -> SceneNotes:
    """Title, purpose and credit from README.md or LICENSE.txt in a scene's folder.

    A file counts when it has the lines `- Author: ...` and `- Licence: ...` (or `License`);
    anything else in the folder is taken to be about something other than the scene.
    """
    for name in _TEXT_FILES:
        path = folder / name
        if not path.is_file():
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        author = _line(r"^- Author:(.*)$", text)
        licence = _line(r"^- Licen[cs]e:(.*)$", text)
        if author and licence:
            licence = _SENTENCE_END.split(licence)[0]
            return SceneNotes(
                title=_line(r"^# (.*)$", text),
                purpose=_line(r"^## What it exercises\s+((?:.+\n?)+)", text),
                credit=f"{author}, {licence}",
            )
    return SceneNotes()


def _line(pattern: str, text: str) -> str:
    found = re.search(pattern, text, re.MULTILINE)
    return " ".join(found.group(1).split()) if found else ""
