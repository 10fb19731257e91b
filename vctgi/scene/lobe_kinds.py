"""Which BSDFs have a single isotropic lobe whose cone stands in a table.

Mitsuba tells a BSDF's roughness at a point by its attribute `alpha`, which only isotropic ones
have. The distribution is a choice at construction; it stands in the BSDF's description.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import drjit as dr
import mitsuba as mi

from vctgi.maths.lobes import TABLES
from vctgi.scene.materials import inside_two_sided
from vctgi.scene.registry import registry_number, table_by_number

COATED = {"RoughConductor": False, "RoughPlastic": True}
"""Mitsuba classes whose specular lobe has a table: whether it has a dielectric's Fresnel factor."""

NO_TABLE = len(TABLES)
"""Entry of a BSDF whose lobe has to be sampled."""


def lobe_table(bsdf: mi.BSDF) -> int:
    """Return the place in `TABLES` of a BSDF's lobe, or `NO_TABLE`."""
    kind = inside_two_sided(bsdf).class_name()
    if kind not in COATED or not dr.all(bsdf.has_attribute("alpha")):
        return NO_TABLE
    named = set(re.findall(r"distribution = (\w+)", str(bsdf)))
    # The sides of a two-sided BSDF may differ.
    wanted = [(name, COATED[kind]) for name in named]
    return TABLES.index(wanted[0]) if len(wanted) == 1 and wanted[0] in TABLES else NO_TABLE


def list_lobe_kinds(bsdfs: Iterable[mi.BSDF]) -> mi.UInt32 | None:
    """Return `lobe_table` by number of the BSDF, or None where none has a table.

    Parameters
    ----------
    bsdfs
        BSDFs of a scene. Numbers are those of Mitsuba's registry; those of other BSDFs read
        `NO_TABLE`, or lie behind the end.
    """
    found = {registry_number(mi.BSDFPtr(bsdf)): lobe_table(bsdf) for bsdf in bsdfs}
    if all(kind == NO_TABLE for kind in found.values()):
        return None
    return table_by_number(found, NO_TABLE)
