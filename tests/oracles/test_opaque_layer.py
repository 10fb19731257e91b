"""Oracle 3: an opaque layer of one voxel, read trilinearly, transmits e^-2; what closes it."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import emittance_of, opacity_of
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.sampling import OPTICAL_DEPTH_CAP, optical_depth
from vctgi.clipmap.storage import VoxelVolume, pack_volume
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.cone_tracing.march import ConeMarchConfig, ConeSample, march_cone

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 16
RAY_COUNT = 16

SMALL_STEPS = 0.005
"""Voxels. The depth of alpha has a logarithmic pole in the middle of the layer, near which
midpoints of steps are off by up to about two steps."""

STEP_ERROR = 3.0 * SMALL_STEPS
"""Relative; measured 2.3 steps at worst."""

CLASSIC: dict[str, Any] = {"read": "trilinear", "correction": "exponent", "weights": "squared"}


def walls(opacity: float, thickness: int) -> VoxelVolume:
    """Layers across x from voxel 2 on, of one opacity and radiance 1."""
    layout = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=1, resolution=RESOLUTION
    )
    alphas = [np.zeros((DIRECTION_COUNT,) + (level.resolution,) * 3) for level in layout.levels]
    alphas[0][:2, :, :, 2 : 2 + thickness] = opacity
    colors = [np.repeat(a[..., None], 3, axis=-1) for a in alphas]
    return pack_volume(opacity_of(layout, alphas), emittance_of(layout, colors))


def cross(volume: VoxelVolume, **rules: Any) -> ConeSample:
    """Cross the layers by thin rays that start at different places."""
    config = ConeMarchConfig(
        min_step_voxels=SMALL_STEPS,
        start_offset_voxels=0.0,
        pull_back_voxels=0.0,
        level_bias=-10.0,
        max_distance_voxels=9.0,
        min_transmittance=0.0,
        **rules,
    )
    places = dr.arange(mi.Float, RAY_COUNT) / RAY_COUNT
    found = march_cone(
        volume,
        mi.Point3f(places * SMALL_STEPS - 3.0, places, 0.3),
        dr.zeros(mi.Vector3f, RAY_COUNT) + mi.Vector3f(1.0, 0.0, 0.0),
        dr.full(mi.Float, 1e-3, RAY_COUNT),
        dr.full(mi.Float, 1.0, RAY_COUNT),
        config,
        dr.full(mi.Bool, True, RAY_COUNT),
    )
    dr.eval(found)
    return found


def test_trilinear_alpha_lets_exp_minus_two_through() -> None:
    # Twice the integral of -ln(x) over [0, 1].
    found = cross(walls(1.0, 1), **CLASSIC)
    np.testing.assert_allclose(np.array(found.transmittance), math.exp(-2.0), rtol=STEP_ERROR)


def test_two_layers_close_it() -> None:
    found = cross(walls(1.0, 2), **CLASSIC)
    assert np.array(found.transmittance).max() < 1e-6
    np.testing.assert_allclose(np.array(found.radiance), 1.0, atol=1e-3)


def test_the_layered_read_closes_one() -> None:
    found = cross(walls(1.0, 1))
    through = math.exp(-OPTICAL_DEPTH_CAP)
    np.testing.assert_allclose(np.array(found.transmittance), through, rtol=STEP_ERROR)
    np.testing.assert_allclose(np.array(found.radiance), 1.0 - through, rtol=1e-4)


def test_the_march_stays_bounded_near_opacity_one() -> None:
    # The last steps of single precision before 1 change nothing, and 1 itself is no exception.
    opacities = [1.0 - 1e-3, 1.0 - 1e-5, np.nextafter(np.float32(1.0), np.float32(0.0)), 1.0]
    found = [cross(walls(float(opacity), 1)) for opacity in opacities]
    through = [float(each.transmittance[0]) for each in found]
    assert all(np.isfinite(np.array(each.radiance)).all() for each in found)
    np.testing.assert_allclose(through, math.exp(-OPTICAL_DEPTH_CAP), rtol=STEP_ERROR)
    assert through[2] == pytest.approx(through[3], rel=1e-6)


@pytest.mark.parametrize("opacity", [0.0, 0.5, 0.99, 0.999999, 1.0])
def test_the_derivative_of_the_depth_is_bounded_by_the_cap(opacity: float) -> None:
    value = mi.Float(opacity)
    dr.enable_grad(value)
    depth, _ = optical_depth(value)
    dr.forward(value)
    assert 0.0 <= float(dr.grad(depth)[0]) <= math.exp(OPTICAL_DEPTH_CAP) * 1.001
