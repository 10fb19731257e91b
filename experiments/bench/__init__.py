"""How fast frames are: times by stage, floors, and counts that no machine changes."""

from __future__ import annotations
