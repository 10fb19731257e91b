"""What Dr.Jit's forward mode by values that BSDFs read needs, so that it does not fail.

Forward mode traces a call of BSDFs once more, and goes along every edge that leads away from a
value that they read and was not gone along. Dr.Jit 1.5 fails where such an edge leads out of the
call, and two kinds do:

- A call keeps what it last returned, which is what the BSDF that was loaded last returned. So where
  that one reads the value, the next call in a loop finds what the call before it left. Therefore
  one BSDF, of which nothing is differentiated, is kept behind all others.
- A bitmap has the mean of its numbers, which need not lie on the way to the picture. Therefore all
  means are put there, without changing it.
"""

from __future__ import annotations

from typing import Any, TypeVar
from weakref import WeakValueDictionary

import drjit as dr
import mitsuba as mi

from vctgi.maths.evaluation import accompanied

Value = TypeVar("Value")


class LastBsdf:
    """Keeps a BSDF in Mitsuba's registry for as long as it lives itself."""

    def __init__(self) -> None:
        self.bsdf: mi.BSDF = mi.load_dict({"type": "diffuse"})

    def is_last(self) -> bool:
        """Whether calls of BSDFs trace this one last."""
        traced: list[mi.BSDF] = []

        def note(bsdf: mi.BSDF) -> mi.Float:
            traced.append(bsdf)
            return mi.Float(0.0)

        # Nothing is evaluated: tracing alone visits all that are registered, in their order
        dr.dispatch(mi.BSDFPtr(self.bsdf), note)
        return traced[-1] is self.bsdf


_alive: WeakValueDictionary[str, LastBsdf] = WeakValueDictionary()


def last_bsdf() -> LastBsdf:
    """Return what is to be kept as long as calls of BSDFs may be differentiated.

    One is made only where none that is still kept is behind all other BSDFs.
    """
    variant = str(mi.variant())
    found = _alive.get(variant)
    passed = []
    while found is None or not found.is_last():
        # A new one may take the place of a BSDF that is gone: these are held until one is behind
        passed.append(found)
        found = LastBsdf()
    _alive[variant] = found
    return found


BITMAP = "BitmapTexture"
"""How the names of Mitsuba's classes of bitmaps begin."""


def texture_means(scene: mi.Scene) -> list[Any]:
    """Return the means of a scene's bitmaps that have derivatives."""
    parameters: Any = mi.traverse(scene)
    owners = {
        owner.ptr: owner
        for name, (_, _, owner, _) in parameters.properties.items()
        if dr.grad_enabled(parameters[name]) and owner.class_name().startswith(BITMAP)
    }
    return [owner.mean() for owner in owners.values()]


def ready_for_forward_mode(scene: mi.Scene, value: Value) -> Value:
    """Return the same, which forward mode can reach from values that BSDFs read.

    Parameters
    ----------
    scene
        Whose BSDFs were called.
    value
        What all that is differentiated follows from: arrays, or a dataclass of them.
    """
    if not dr.grad_enabled(value):
        return value
    return accompanied(value, last_bsdf(), texture_means(scene))
