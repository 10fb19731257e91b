"""The examples at small size: they find again what they look for."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.examples import fit_apertures, recover_room
from vctgi.parameters import ConeParameters

pytestmark = pytest.mark.usefixtures("variant")

BIAS_OF_CONES = 0.15
"""Of an albedo and of a power over the true ones, with 16 voxels along the edge and few samples."""

STEPS = {"cones": 20, "prb": 60}
"""Steps by cones take longer; what these have left is within their bias."""

BIAS_OF_PATHS = 0.06
"""Noise of eight paths a pixel and step, and of the picture."""


@pytest.mark.parametrize("way", ["cones", "prb"])
def test_a_room_is_recovered(way: str) -> None:
    room = recover_room.make_room(edge=12, paths=1024)
    integrator = (
        mi.load_dict({"type": "vctgi", "preset": "medium", "resolution": 16, "cone_count": 4})
        if way == "cones"
        else room.paths("prb")
    )
    found = recover_room.recover(room, integrator, steps=STEPS[way], samples=8)
    bound = BIAS_OF_CONES if way == "cones" else BIAS_OF_PATHS
    assert found.power == pytest.approx(1.0, abs=bound)
    np.testing.assert_allclose(found.albedo, np.array(room.albedo).ravel(), atol=bound)
    assert recover_room.seen_error(room, found, paths=1024) < bound


def test_apertures_are_found_again() -> None:
    """A picture of cones of known width, from half of it: their common width is found."""
    box = fit_apertures.make_box(edge=12, voxels=16, cone_count=4)
    true = ConeParameters.from_config(box.config)["apertures"]
    target = dr.detach(box.picture(true, 0))

    def picture(apertures: mi.Float, _seed: int) -> mi.Float:
        return box.picture(apertures, 0)

    found, losses = fit_apertures.fit(picture, target, mi.Float(0.6 * true), steps=25)
    assert losses[-1] < 0.05 * losses[0]
    assert found.mean() == pytest.approx(float(np.array(true).mean()), rel=0.1)
