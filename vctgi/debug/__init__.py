"""Pictures of intermediate data. The rest of the renderer may not import this."""

from __future__ import annotations
