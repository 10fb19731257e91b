"""What is read off a Mitsuba scene: triangles, materials, lights and surfaces."""

from __future__ import annotations
