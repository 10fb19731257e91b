"""Cones moved within their rings: where axes may go, and that together they fill the hemisphere."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from experiments.studies.peers.cone_sets import DC_TOLERANCE, glowing_fog
from vctgi.maths.cones import ring_cone_set, ring_rims, ring_sizes
from vctgi.parameters import ConeParameters
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, diffuse_lanes, trace_diffuse
from vctgi.stages.cone_tracing.lane_order import cone_after_cone
from vctgi.stages.cone_tracing.march import ConeMarchConfig

pytestmark = pytest.mark.usefixtures("variant")

COUNT = 17
POINTS = 500
STILL = DiffuseConesConfig(cone_count=COUNT, rotation="fixed", is_jittered=False, ring_jitter=1.0)

ROUNDING = 2e-6
"""Of a squared sine in single precision."""

SPREAD = 0.03
"""Kolmogorov's distance of 8500 numbers of which the 500 of a cone are independent: 0.0608 would be
one in a hundred thousand for 500 alone, and strata halve it."""


def axes(config: DiffuseConesConfig, *, is_live: bool = False) -> np.ndarray:
    """Return the axes [cone, point, xyz] of points that look up."""
    up = np.repeat([[0.0, 0.0, 1.0]], POINTS, axis=0)
    at = white_receivers(np.zeros((POINTS, 3)), up)
    parameters = ConeParameters.from_config(config) if is_live else None
    table = cone_after_cone(POINTS, config.cone_count)
    lanes = diffuse_lanes(at, glowing_fog(), config.cones(), config, table, parameters)
    return np.array(lanes.axis).T.reshape(COUNT, POINTS, 3)


def squared_sines(found: np.ndarray) -> np.ndarray:
    return np.asarray(found[..., 0] ** 2 + found[..., 1] ** 2)


def test_rims_of_rings_meet() -> None:
    for count in (1, 5, 6, 17, 64):
        rims, sizes = ring_rims(count), ring_sizes(count)
        assert [rims.count(each) for each in dict.fromkeys(rims)] == list(sizes)
        ends = [0.0, *(high for _, high in dict.fromkeys(rims))]
        assert [low for low, _ in dict.fromkeys(rims)] == ends[:-1]
        assert ends[-1] == 1.0


def test_axes_stay_in_their_rings_and_keep_their_azimuth() -> None:
    found = axes(STILL)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, atol=ROUNDING)
    low, high = np.array(ring_rims(COUNT)).T
    sines = squared_sines(found)
    assert np.all(sines >= low[:, None] - ROUNDING)
    assert np.all(sines <= high[:, None] + ROUNDING)
    held = np.array(ring_cone_set(COUNT).directions)
    across = found[1:, :, 0] * held[1:, None, 1] - found[1:, :, 1] * held[1:, None, 0]
    np.testing.assert_allclose(across, 0.0, atol=ROUNDING)


def test_all_axes_together_are_spread_by_the_cosine() -> None:
    sines = np.sort(squared_sines(axes(STILL)).ravel())
    even = (np.arange(len(sines)) + 0.5) / len(sines)
    assert float(np.abs(sines - even).max()) < SPREAD
    # Without jitter only three elevations are seen.
    fixed = np.sort(squared_sines(axes(replace(STILL, ring_jitter=0.0))).ravel())
    assert float(np.abs(fixed - even).max()) > 0.2


def test_half_the_jitter_goes_half_the_way() -> None:
    none, half, full = (
        squared_sines(axes(replace(STILL, ring_jitter=each))) for each in (0.0, 0.5, 1.0)
    )
    np.testing.assert_allclose(half, 0.5 * (none + full), atol=ROUNDING)


def test_arrays_of_parameters_are_moved_alike() -> None:
    np.testing.assert_allclose(axes(STILL, is_live=True), axes(STILL), atol=1e-3)


def test_an_even_environment_is_seen_as_before() -> None:
    march = ConeMarchConfig(min_transmittance=0.0)
    at = white_receivers(np.zeros((POINTS, 3)), np.repeat([[0.0, 0.0, 1.0]], POINTS, axis=0))
    found = np.array(trace_diffuse(at, glowing_fog(), replace(STILL, march=march)))
    np.testing.assert_allclose(found, 2.0, rtol=DC_TOLERANCE)


def test_what_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match=r"ring_jitter must be in \[0, 1\], got 1.5"):
        replace(STILL, ring_jitter=1.5)
    with pytest.raises(ValueError, match="stand in no rings"):
        DiffuseConesConfig(cone_count=6, cone_set="crassin6", ring_jitter=0.5)


def test_derivatives_by_elevations_are_finite_at_the_pole_too() -> None:
    parameters = ConeParameters.from_config(STILL)
    dr.enable_grad(parameters["elevations"])
    at = white_receivers(np.zeros((8, 3)), np.repeat([[0.0, 0.0, 1.0]], 8, axis=0))
    found = trace_diffuse(at, glowing_fog(), STILL, parameters=parameters)
    dr.backward(dr.sum(found.x))
    assert np.all(np.isfinite(np.array(dr.grad(parameters["elevations"]))))
