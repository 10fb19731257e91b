"""Oracle 4: a wall of one voxel stays closed in six-direction mips.

That it opens in isotropic ones is a row of `vctgi study representation`, for comparison.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import opacity_of
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.downsampling import downsample

pytestmark = pytest.mark.usefixtures("variant")

RESOLUTION = 32


def wall(layout: ClipmapLayout) -> list[np.ndarray]:
    """Opacities of a wall one voxel thick across x that stops light from both sides."""
    levels = [np.zeros((DIRECTION_COUNT,) + (level.resolution,) * 3) for level in layout.levels]
    levels[0][:2, :, :, 5] = 1.0
    return levels


@pytest.mark.parametrize("level", [1, 2, 3])
def test_mips_of_a_wall_let_nothing_through_along_its_normal(level: int) -> None:
    layout = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=1, resolution=RESOLUTION
    )
    found, _ = downsample(opacity_of(layout, wall(layout)), None)
    edge = layout.levels[level].resolution
    table = np.array(found.levels[level]).reshape((DIRECTION_COUNT,) + (edge,) * 3)
    for side in range(2):
        columns = table[side].max(axis=2)
        np.testing.assert_array_equal(columns, 1.0)
    # Along the wall only its own layer stops light: that share of the voxel's face.
    assert table[2:].max() == 0.0
