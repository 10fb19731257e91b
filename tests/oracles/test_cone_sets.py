"""Oracle 1: cone sets against the exact cosine integral of the first spherical harmonics.

That traced light has their gain too is a test of the diffuse cones.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from experiments.studies.peers.harmonics import band_error, even_normals, normalised_weights
from vctgi.maths.cones import (
    MAX_CONE_COUNT,
    RINGS,
    aperture_from_solid_angle,
    ring_cone_set,
    ring_sizes,
)
from vctgi.maths.peer_cones import PEER_CONE_SETS, peer_cone_set

ROUNDING = 1e-12

LARGEST_BAND_ONE = 0.02
"""Measured at most 0.0181, of 13 cones."""

BAND_TWO_OF_ONE_CONE = 0.21
"""Band 2 of n cones times n, measured at most 0.196, of 29 cones."""

BAND_ERRORS = {
    # cones: largest error in bands 1 and 2, the measured one and a tenth more. The best six-cone
    # set of other systems has 0.084 and 0.124, their best of sixteen 0.040 and 0.043.
    6: (0.0132, 0.0206),
    9: (0.0102, 0.0197),
    16: (0.0064, 0.0104),
    17: (0.0057, 0.0095),
    32: (0.0057, 0.0048),
    64: (0.0082, 0.0025),
    256: (0.0044, 0.0005),
}


KNOWN_ERRORS = {
    # Bands 1 and 2 of other systems' sets, from models of their sources.
    "crassin6": (0.084, 0.124),
    "vctrenderer6": (0.096, 0.168),
    "four": (0.063, 0.099),
    "friduric9": (0.102, 0.162),
    "stride6": (0.155, 0.200),
    "wicked16": (0.040, 0.043),
    "wicked32": (0.018, 0.022),
}

KNOWN_ROUNDING = 1.2e-3
"""They are given to three digits; sets of the world are averaged over 500 normals."""

OUR_ERRORS = {
    # Sets whose published description leaves something open, and what they are known to have: the
    # phase of the Hammersley sequence (0.051, 0.099), the phase of the spiral (0.311, 0.213), axes
    # and aperture to within a few degrees (0.059, 0.050).
    "hanetaka8": (0.0439, 0.0741),
    "threejs3": (0.1404, 0.2358),
    "stride12": (0.0729, 0.0640),
}


def test_error_measure_reproduces_the_closed_form() -> None:
    # |0.25 + 0.75 / 2| smoothed, less 2 / 3 and 1 / 4.
    assert band_error(peer_cone_set("crassin6"), 1) == pytest.approx(0.0835, abs=5e-4)
    assert band_error(peer_cone_set("crassin6"), 2) == pytest.approx(0.1237, abs=5e-4)


@pytest.mark.parametrize("name", KNOWN_ERRORS)
def test_sets_of_other_systems_have_their_known_errors(name: str) -> None:
    for band, known in zip((1, 2), KNOWN_ERRORS[name], strict=True):
        assert band_error(peer_cone_set(name), band) == pytest.approx(known, abs=KNOWN_ROUNDING)


@pytest.mark.parametrize("name", OUR_ERRORS)
def test_sets_that_are_not_fully_described_have_ours(name: str) -> None:
    for band, known in zip((1, 2), OUR_ERRORS[name], strict=True):
        assert band_error(peer_cone_set(name), band) == pytest.approx(known, abs=1e-4)


def test_the_divisor_of_compix_halves_the_light() -> None:
    cones = peer_cone_set("compix16")
    assert cones.published_gain == 0.5
    for band, known in ((1, 0.349), (2, 0.142)):
        assert band_error(cones, band, gain=0.5) == pytest.approx(known, abs=KNOWN_ROUNDING)


@pytest.mark.parametrize("name", PEER_CONE_SETS)
def test_weights_of_other_systems_are_normalised_for_every_surface(name: str) -> None:
    cones = peer_cone_set(name)
    weights = normalised_weights(cones, even_normals(50))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=ROUNDING)
    if cones.frame == "tangent":
        assert sum(cones.weights) == pytest.approx(1.0, abs=ROUNDING)
    d = np.array(cones.directions)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, atol=ROUNDING)
    assert len({tuple(np.round(axis, 6)) for axis in d}) == cones.cone_count


@pytest.mark.parametrize("name", ["compix16", "compix32", "strayphotons6"])
def test_axes_of_the_world_prefer_no_direction(name: str) -> None:
    d = np.array(peer_cone_set(name).directions)
    np.testing.assert_allclose(d.mean(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(d.T @ d / len(d), np.eye(3) / 3.0, atol=1e-6)


def test_apertures_of_named_sets_are_scaled() -> None:
    once, twice = peer_cone_set("friduric9"), peer_cone_set("friduric9", 2.0)
    assert twice.apertures[0] == pytest.approx(2.0 * once.apertures[0])
    with pytest.raises(ValueError, match="no set 'none'"):
        peer_cone_set("none")


@pytest.mark.parametrize("count", range(1, MAX_CONE_COUNT + 1))
def test_every_count_has_a_set(count: int) -> None:
    cones = ring_cone_set(count)
    assert cones.cone_count == count
    assert min(ring_sizes(count)) > 0
    assert sum(cones.weights) == pytest.approx(1.0, abs=ROUNDING)
    d = np.array(cones.directions)
    assert np.hypot(*d[:, :2].mean(axis=0)) < ROUNDING
    # From six cones on, no worse than the best six-cone set: the error of band 2 falls as 1 / n.
    if count >= 6:
        assert band_error(cones, 1) < LARGEST_BAND_ONE
        assert band_error(cones, 2) < BAND_TWO_OF_ONE_CONE / count


@pytest.mark.parametrize("count", RINGS)
def test_weights_sum_to_one_so_a_constant_environment_gives_pi(count: int) -> None:
    cones = ring_cone_set(count)
    assert cones.cone_count == count == sum(RINGS[count])
    assert sum(cones.weights) == pytest.approx(1.0, abs=ROUNDING)
    assert all(weight > 0.0 for weight in cones.weights)


@pytest.mark.parametrize("count", RINGS)
def test_axes_are_unit_vectors_above_the_surface(count: int) -> None:
    d = np.array(ring_cone_set(count).directions)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, atol=ROUNDING)
    assert np.all(d[:, 2] > 0.0)
    # No azimuth is preferred.
    assert np.hypot(*d[:, :2].mean(axis=0)) < ROUNDING


@pytest.mark.parametrize("count", RINGS)
def test_harmonic_errors_stay_bounded(count: int) -> None:
    cones = ring_cone_set(count)
    for band, bound in zip((1, 2), BAND_ERRORS[count], strict=True):
        assert band_error(cones, band) <= bound


@pytest.mark.parametrize("count", RINGS)
@pytest.mark.parametrize("scale", [0.5, 1.0])
def test_apertures_cover_the_solid_angle_of_equal_shares(count: int, scale: float) -> None:
    cones = ring_cone_set(count, scale)
    for direction, aperture in zip(cones.directions, cones.apertures, strict=True):
        solid_angle = 2.0 * math.pi * (1.0 - math.cos(0.5 * aperture / scale))
        assert solid_angle * direction[2] == pytest.approx(math.pi / count, rel=1e-9)


def test_aperture_of_a_half_space_is_pi() -> None:
    assert aperture_from_solid_angle(2.0 * math.pi) == pytest.approx(math.pi)
    assert aperture_from_solid_angle(0.0) == 0.0


@pytest.mark.parametrize("count", [0, 65, 255])
def test_unknown_set_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match=f"no set of {count} cones; choose 1 .. 64 or 256"):
        ring_cone_set(count)
