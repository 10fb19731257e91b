"""From gathered light to whole pictures: fewer traced pixels, filled in; frames accumulated."""

from __future__ import annotations
