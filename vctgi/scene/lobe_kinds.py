"""Which BSDFs have a single isotropic lobe whose cone stands in a table.

Mitsuba tells a BSDF's roughness at a point by its attribute `alpha`, which only isotropic ones
have. The distribution is a choice at construction; it stands in the BSDF's description.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.lobes import DISTRIBUTIONS
from vctgi.scene.materials import inside_two_sided

TABLED_KINDS = ("RoughConductor", "RoughPlastic")
"""Mitsuba classes whose specular lobe is that of a rough mirror, up to Fresnel's factor."""

NO_TABLE = len(DISTRIBUTIONS)
"""Entry of a BSDF whose lobe has to be sampled."""


def lobe_distribution(bsdf: mi.BSDF) -> int:
    """Return the place in `DISTRIBUTIONS` of a BSDF's lobe, or `NO_TABLE`."""
    kind = inside_two_sided(bsdf).class_name()
    if kind not in TABLED_KINDS or not dr.all(bsdf.has_attribute("alpha")):
        return NO_TABLE
    named = set(re.findall(r"distribution = (\w+)", str(bsdf)))
    # The sides of a two-sided BSDF may differ.
    known = [place for place, name in enumerate(DISTRIBUTIONS) if named == {name}]
    return known[0] if known else NO_TABLE


def list_lobe_kinds(bsdfs: Iterable[mi.BSDF]) -> mi.UInt32 | None:
    """Return `lobe_distribution` by number of the BSDF, or None where none has a table.

    Parameters
    ----------
    bsdfs
        BSDFs of a scene. Numbers are those of Mitsuba's registry; those of other BSDFs read
        `NO_TABLE`, or lie behind the end.
    """
    found = {}
    for bsdf in bsdfs:
        pointer = mi.BSDFPtr(bsdf)
        found[int(dr.reinterpret_array(mi.UInt32, pointer)[0])] = lobe_distribution(bsdf)
    if all(kind == NO_TABLE for kind in found.values()):
        return None
    kinds = np.full(max(found) + 1, NO_TABLE, dtype=np.uint32)
    for number, kind in found.items():
        kinds[number] = kind
    return mi.UInt32(kinds)
