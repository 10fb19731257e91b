"""Cones: how one marches through the clipmap, and which ones a point sends out."""

from __future__ import annotations
