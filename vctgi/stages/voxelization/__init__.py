"""Triangles into voxels: which cells of a face they cover, and so its opacity."""

from __future__ import annotations
