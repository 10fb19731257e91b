"""Parameters of emitters and masks that are the same all over, so that nothing has to be sampled.

What is read here are the numbers themselves: zero is zero, and a lamp that samples happened to find
dark is not called so. Parameters with derivatives count as what they may become.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.scene.materials import MASK, inside_two_sided, nested_bsdfs

VALUES = ("value", "data")
"""Last parts of the names of parameters that hold colours or pictures."""

RADIANT = ("radiance", "intensity", "irradiance", "data")
"""First parts of the names of parameters that an emitter's light is a multiple of."""


def is_dark(emitter: mi.Emitter) -> bool:
    """Whether an emitter's light is zero in every direction, from every point."""
    parameters = _parameters(emitter)
    if _is_all(parameters.get("scale"), 0.0):
        return True
    light = [
        held
        for name, held in parameters.items()
        if name.split(".")[0] in RADIANT and name.split(".")[-1] in VALUES
    ]
    return bool(light) and all(_is_all(held, 0.0) for held in light)


def is_opaque_mask(bsdf: mi.BSDF) -> bool:
    """Whether a BSDF is a mask that is opaque all over, around one that lets no light pass."""
    mask = inside_two_sided(bsdf)
    if mask.class_name() != MASK:
        return False
    null = int(mi.BSDFFlags.Null)
    if any(int(nested.flags()) & null for nested in nested_bsdfs(mask)):
        return False
    opacity = [
        held
        for name, held in _parameters(mask).items()
        if name.startswith("opacity.") and name.split(".")[-1] in VALUES
    ]
    return bool(opacity) and all(_is_all(held, 1.0) for held in opacity)


def _parameters(part: mi.Object) -> dict[str, object]:
    return dict(mi.traverse(part).items())  # type: ignore[no-untyped-call]


def _is_all(held: object, number: float) -> bool:
    """Whether a parameter is there, has no derivatives, and is a number all over."""
    if held is None or dr.grad_enabled(held):
        return False
    values = np.array(held, dtype=np.float64)
    return values.size > 0 and bool((values == number).all())
