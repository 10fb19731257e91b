"""What surfaces stand behind the slots of the voxels: where, how turned, how reflecting."""

from __future__ import annotations
