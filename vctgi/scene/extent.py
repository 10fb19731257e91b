"""How large a scene is."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi


def half_extent(scene: mi.Scene) -> mi.Float:
    """Return half the longest edge of a scene's bounds, world units, as no kernel's constant."""
    return dr.opaque(mi.Float, 0.5 * max(float(edge) for edge in scene.bbox().extents()))
