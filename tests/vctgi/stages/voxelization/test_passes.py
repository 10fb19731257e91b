"""What does not fit one pass is done in several, with the same result bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.stages.voxelization import candidates, columns, opacity
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig, voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")


def voxels(coverage: opacity.Coverage) -> list[np.ndarray]:
    rng = np.random.default_rng(6)
    corners = rng.uniform(-3.0, 3.0, (60, 1, 3)) + rng.uniform(-0.7, 0.7, (60, 3, 3))
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.2, level_count=3, resolution=16)
    config = OpacityVoxelizationConfig(coverage=coverage)
    found = voxelize_opacity(opaque_surfaces(corners), layout, config)
    return [np.array(level) for level in found.levels]


@pytest.mark.parametrize("coverage", ["cells", "samples", "analytic"])
@pytest.mark.parametrize(
    ("module", "name", "size"),
    [
        (opacity, "WORDS_PER_PASS", 6 * 500),
        (columns, "COLUMNS_PER_PASS", 37),
        (columns, "PAIRS_PER_PASS", 11),
        (candidates, "ALL_PAIRS_UP_TO", 0),
        (opacity, "TEXELS_AT_ONCE", 0),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_small_passes_change_nothing(
    monkeypatch: pytest.MonkeyPatch,
    coverage: opacity.Coverage,
    module: object,
    name: str,
    size: int,
) -> None:
    whole = voxels(coverage)
    monkeypatch.setattr(module, name, size)
    for own, expected in zip(voxels(coverage), whole, strict=True):
        np.testing.assert_array_equal(own, expected)
    assert any(level.any() for level in whole)
