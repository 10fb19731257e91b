"""Cones of lobes against Mitsuba's own BSDFs, and against what must hold for any lobe."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import pytest

from experiments.studies.accuracy.true_lobes import true_lobe_cone
from vctgi.maths.lobes import (
    DISTRIBUTIONS,
    TABLES,
    LobeCone,
    LobeDistribution,
    cone_of_directions,
    lobe_cone,
    read_lobe_cone,
)

pytestmark = pytest.mark.usefixtures("variant")

FIT_ERROR = 0.015
"""Relative: 64 x 24 half vectors, read between 18 x 18 places."""

EVEN_CONE = 0.01
"""Radians: 1e5 directions, drawn evenly."""


def read(distribution: LobeDistribution, alpha: float, cosine: float, is_coat: bool) -> LobeCone:
    table = mi.UInt32(TABLES.index((distribution, is_coat)))
    aperture, tilt = read_lobe_cone(table, mi.Float(alpha), mi.Float(cosine))
    return LobeCone(float(aperture[0]), float(tilt[0]))


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("kind", ["roughconductor", "roughplastic"])
@pytest.mark.parametrize(("alpha", "degrees"), [(0.03, 75.0), (0.15, 0.0), (0.3, 50.0)])
def test_table_holds_the_lobes_that_mitsuba_has(
    distribution: LobeDistribution, kind: str, alpha: float, degrees: float
) -> None:
    cosine = math.cos(math.radians(degrees))
    exact = true_lobe_cone(distribution, alpha, cosine, kind)
    found = read(distribution, alpha, cosine, kind == "roughplastic")
    assert found.aperture == pytest.approx(exact.aperture, rel=FIT_ERROR)
    assert found.tilt == pytest.approx(exact.tilt, abs=FIT_ERROR * exact.aperture)


@pytest.mark.parametrize("half_angle", [0.1, 0.8, 1.2])
def test_cone_of_an_even_cone_is_itself(half_angle: float) -> None:
    rng = np.random.default_rng(2)
    z = 1.0 - (1.0 - math.cos(half_angle)) * rng.random(100_000)
    phi = 2.0 * math.pi * rng.random(len(z))
    radius = np.sqrt(1.0 - z**2)
    local = np.stack([radius * np.cos(phi), radius * np.sin(phi), z])
    sine, cosine = math.sin(0.4), math.cos(0.4)
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    found = cone_of_directions(turn @ local, np.ones(len(z)), (0.0, 0.0, 1.0))
    assert found.aperture == pytest.approx(2.0 * half_angle, abs=EVEN_CONE)
    assert found.tilt == pytest.approx(0.4, abs=EVEN_CONE)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_apertures_grow_with_roughness(distribution: LobeDistribution) -> None:
    found = [lobe_cone(distribution, alpha, 0.7).aperture for alpha in (0.02, 0.1, 0.3, 0.6)]
    assert np.all(np.diff(found) > 0.0)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_smooth_surfaces_mirror(distribution: LobeDistribution) -> None:
    for degrees in (0.0, 40.0, 80.0):
        found = read(distribution, 0.0, math.cos(math.radians(degrees)), False)
        assert found.aperture == 0.0
        assert math.degrees(found.tilt) == pytest.approx(degrees, abs=0.1)


def test_long_tail_does_not_widen_the_cone() -> None:
    # Half of GGX's normals are tilted by less than alpha, of Beckmann's by less than 0.83 alpha
    alpha = 0.02
    for distribution, median in (("ggx", 1.0), ("beckmann", math.sqrt(math.log(2.0)))):
        found = read(distribution, alpha, 1.0, False)  # type: ignore[arg-type]  # of the tuple
        assert found.aperture == pytest.approx(
            2.0 * math.sqrt(2.0) * 2.0 * alpha * median, rel=0.02
        )
