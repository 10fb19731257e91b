"""Oracle 2: a homogeneous medium of extinction s transmits exp(-s d), whatever the step."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import pytest

from tests.vctgi.hand_made_volumes import homogeneous_volume
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone

pytestmark = pytest.mark.usefixtures("variant")

VOXEL_SIZE = 0.25
RESOLUTION = 64
"""Windows of 16, 32 and 64 world units around the origin."""


def transmittance(
    extinction: float, axis: tuple[float, float, float], ratio: float, config: ConeMarchConfig
) -> float:
    layout = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=VOXEL_SIZE, level_count=3, resolution=RESOLUTION
    )
    cone = march_cone(
        homogeneous_volume(layout, extinction),
        mi.Point3f(0.0),
        mi.Vector3f(*axis),
        mi.Float(ratio),
        mi.Float(1.0),
        config,
        dr.full(mi.Bool, True, 1),
    )
    return float(cone.transmittance[0])


def path_length(config: ConeMarchConfig) -> float:
    """From the start of the march to the window's rim, where the read fades out."""
    rim = 0.5 * RESOLUTION * VOXEL_SIZE * 4.0
    return rim - config.start_offset_voxels * VOXEL_SIZE


STEP_TOLERANCE = 1e-3
"""Absolute, of the transmittance; what a medium that ends inside the window leaves to rounding."""

INSIDE_VOXELS = 24.0
"""Where cones end within the finest window."""

ACROSS_LEVELS_VOXELS = 100.0
"""Where they end in the coarsest one, far from its rim."""

ALPHA_ACROSS_LEVELS = 0.015
"""Absolute, of the transmittance. Rules that interpolate alpha between levels, as most systems do,
are not exact there: 1 - exp(-x) is not linear in x. Measured 0.0114; ours interpolates depth."""

RULES: dict[str, dict[str, object]] = {
    "layered": {},
    "trilinear": {"read": "trilinear"},
    "exponent": {"read": "trilinear", "correction": "exponent", "weights": "squared"},
    "normalised": {"read": "trilinear", "correction": "exponent", "weights": "normalised"},
    "end of the step": {"read": "trilinear", "correction": "exponent", "weights": "squared"}
    | {"sample_place": 1.0},
}
"""Rules that are right for a homogeneous medium; linear correction and none are not."""


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("step_voxels", [0.1, 0.3, 1.0, 2.0])
def test_transmittance_does_not_depend_on_the_step(rule: str, step_voxels: float) -> None:
    config = ConeMarchConfig(
        min_step_voxels=step_voxels,
        max_distance_voxels=INSIDE_VOXELS,
        pull_back_voxels=0.0,
        level_bias=0.0,
        **RULES[rule],  # type: ignore[arg-type]
    )
    length = (INSIDE_VOXELS - config.start_offset_voxels) * VOXEL_SIZE
    for extinction in (0.01, 0.05, 0.2):
        # Thin, so that the step is the shortest one and all is read from the finest level.
        found = transmittance(extinction, (1.0, 0.0, 0.0), 1e-3, config)
        assert found == pytest.approx(math.exp(-extinction * length), abs=STEP_TOLERANCE)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("step_ratio", [0.1, 0.5, 1.0])
def test_a_wide_cone_transmits_the_same_across_levels(rule: str, step_ratio: float) -> None:
    config = ConeMarchConfig(
        step_ratio=step_ratio,
        max_distance_voxels=ACROSS_LEVELS_VOXELS,
        level_bias=0.0,
        **RULES[rule],  # type: ignore[arg-type]
    )
    length = (ACROSS_LEVELS_VOXELS - config.start_offset_voxels) * VOXEL_SIZE
    found = transmittance(0.02, (1.0, 0.0, 0.0), 0.5, config)
    error = STEP_TOLERANCE if config.correction == "depth" else ALPHA_ACROSS_LEVELS
    assert found == pytest.approx(math.exp(-0.02 * length), abs=error)


FADE_AT_THE_RIM = 0.015
"""Relative, of the optical depth. The read fades out over one voxel of the level read around the
rim; while the level changes over that ramp, its two halves do not quite cancel."""

STEP_INVARIANCE = 0.03
"""Relative, of the optical depth: steps as long as the ramp at the rim sample it coarsely."""


@pytest.mark.parametrize("step_ratio", [0.05, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.3])
@pytest.mark.parametrize("extinction", [0.01, 0.05, 0.1])
def test_axis_transmits_exponentially(extinction: float, ratio: float, step_ratio: float) -> None:
    config = ConeMarchConfig(step_ratio=step_ratio, pull_back_voxels=0.0, level_bias=0.0)
    found = -math.log(transmittance(extinction, (1.0, 0.0, 0.0), ratio, config))
    assert found == pytest.approx(extinction * path_length(config), rel=FADE_AT_THE_RIM)


@pytest.mark.parametrize("axis", [(0.0, 0.6, 0.8), (0.48, -0.6, 0.64)])
def test_step_length_does_not_matter_in_any_direction(axis: tuple[float, float, float]) -> None:
    depths = [
        -math.log(transmittance(0.03, axis, 0.2, ConeMarchConfig(step_ratio=step_ratio)))
        for step_ratio in (0.05, 0.25, 0.5, 1.0)
    ]
    assert max(depths) == pytest.approx(min(depths), rel=STEP_INVARIANCE)
    # The projected-area rule: three perpendicular sheets, each as steep as the axis makes it.
    reach = 0.5 * RESOLUTION * VOXEL_SIZE * 4.0 / max(abs(a) for a in axis) - VOXEL_SIZE
    assert depths[0] == pytest.approx(0.03 * sum(abs(a) for a in axis) * reach, rel=0.03)
