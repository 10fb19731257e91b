"""Sweeps: many runs from one file, each in a process of its own, that survive every kill."""

from __future__ import annotations
