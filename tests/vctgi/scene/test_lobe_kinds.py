"""Which BSDFs have a table for their lobe."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

from tests.vctgi.bsdf_kinds import all_kinds
from vctgi.maths.lobes import TABLES
from vctgi.scene.lobe_kinds import NO_TABLE, list_lobe_kinds, lobe_table

pytestmark = pytest.mark.usefixtures("variant")


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize(("kind", "is_coat"), [("roughconductor", False), ("roughplastic", True)])
def test_isotropic_rough_mirrors_have_one(distribution: str, kind: str, is_coat: bool) -> None:
    lobe: dict[str, Any] = {"type": kind, "alpha": 0.2, "distribution": distribution}
    for description in (lobe, {"type": "twosided", "bsdf": lobe}):
        table = lobe_table(mi.load_dict(description))
        assert TABLES[table] == (distribution, is_coat)


def test_others_have_none() -> None:
    plain = {"roughconductor", "roughplastic", "twosided"}
    for name, description in all_kinds().items():
        assert (lobe_table(mi.load_dict(description)) == NO_TABLE) == (name not in plain)
    stretched = {"type": "roughconductor", "alpha_u": 0.3, "alpha_v": 0.1}
    assert lobe_table(mi.load_dict(stretched)) == NO_TABLE
    sides = {
        "type": "twosided",
        "a": {"type": "roughconductor", "distribution": "ggx"},
        "b": {"type": "roughconductor", "distribution": "beckmann"},
    }
    assert lobe_table(mi.load_dict(sides)) == NO_TABLE


def test_list_is_by_number_of_the_bsdf() -> None:
    bsdfs = [mi.load_dict({"type": kind}) for kind in ("diffuse", "roughconductor")]
    kinds = list_lobe_kinds(bsdfs)
    assert kinds is not None
    number = mi.UInt32(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdfs[1])))
    assert dr.gather(mi.UInt32, kinds, number)[0] == TABLES.index(("beckmann", False))
    assert list_lobe_kinds(bsdfs[:1]) is None
