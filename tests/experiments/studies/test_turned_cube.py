"""A small lit cube: what its voxels hold in closed form, and a ledger that closes on its truth."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.studies.aliasing.turned_cube import (
    CLOSED,
    LEDGER_EDGE,
    THIN,
    LitCube,
    cone_seen,
    lit_cubes,
    power_share,
    slot_share,
    truly_seen,
)
from experiments.studies.check import StudyContext
from vctgi.clipmap.slots import SlotRule

pytestmark = pytest.mark.usefixtures("variant")

LOST = 0.03
"""Share of the light that texels may lose which lie in slivers of a voxel without opacity."""


def first_cube(*, is_turned: bool) -> LitCube:
    context = StudyContext(quick=True, progress=lambda _step, _share: None)
    return lit_cubes(context, LEDGER_EDGE, is_turned=is_turned)[0]


def test_along_the_axes_each_face_is_in_the_voxels_once() -> None:
    cube = first_cube(is_turned=False)
    assert power_share(cube) == pytest.approx(1.0, abs=LOST)
    assert slot_share(cube) == pytest.approx(1.0, abs=1e-3)


def test_a_turned_cube_shines_twice_from_three_slots_and_the_ledger_closes() -> None:
    cube = first_cube(is_turned=True)
    # Every sloped point fills the voxel behind its own, too.
    assert power_share(cube) == pytest.approx(2.0, abs=2.0 * LOST)
    # |n_k| |d_k| over those axes that face the eye is the cosine at least.
    assert 1.1 < slot_share(cube) < 1.7
    as_it_is, thin, true = (
        float(np.mean(each)) / float(cube.truth.mean())
        for each in (cone_seen(cube, SlotRule()), cone_seen(cube, THIN), truly_seen(cube))
    )
    assert true == pytest.approx(1.0, abs=CLOSED)
    assert thin < 1.5 < as_it_is
