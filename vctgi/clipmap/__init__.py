"""The clipmap: where its levels lie, how voxels are stored in them, how they are read."""

from __future__ import annotations
