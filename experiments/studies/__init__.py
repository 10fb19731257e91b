"""Named experiments: each asks one question of the renderer and answers it in checked numbers."""

from __future__ import annotations
