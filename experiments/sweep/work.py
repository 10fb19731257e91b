"""What a sweep needs to know of a job to run it: its words for lists, and the command."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Work:
    """A job as the executor sees it."""

    label: str
    command: tuple[str, ...]
    """See `attempt.Ticket`."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """What a table of results shows of it."""
    content: str = ""
    """Goes into the job's file."""

    def write(self, path: Path) -> None:
        """Write the job's file, whole or not at all."""
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".job-")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(self.content)
            Path(name).replace(path)
        finally:
            Path(name).unlink(missing_ok=True)
