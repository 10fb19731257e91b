"""Fit a preset's numbers to path-traced references: `vctgi optimize`."""

from __future__ import annotations
