"""Scenes, studies, gates and the command line: what puts the other packages together."""

from __future__ import annotations
