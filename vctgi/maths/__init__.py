"""Pure functions of numbers: cones, directions and hashes."""

from __future__ import annotations
