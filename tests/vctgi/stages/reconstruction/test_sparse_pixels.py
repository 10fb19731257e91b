"""The pattern of traced pixels: one a block, a Latin square of blocks, none side by side."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vctgi.stages.reconstruction.config import EDGES, ReconstructionConfig
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid, select_sparse_pixels

pytestmark = pytest.mark.usefixtures("variant")

LEAST_DISTANCE = {1: 1.0, 2: math.sqrt(2.0), 3: math.sqrt(5.0), 4: math.sqrt(10.0)}
"""Between traced pixels, by the edge of a block: the largest that such patterns reach."""


def traced_places(grid: SparseGrid) -> np.ndarray:
    """[block, 2] column and row of each traced pixel."""
    pixel = np.array(select_sparse_pixels(grid))
    return np.stack([pixel % grid.width, pixel // grid.width], axis=1)


@pytest.mark.parametrize("edge", EDGES.values())
@pytest.mark.parametrize("layer", [0, 1, 7])
@pytest.mark.parametrize("size", [(48, 48), (50, 37), (2, 3)])
def test_every_block_has_one_traced_pixel(edge: int, layer: int, size: tuple[int, int]) -> None:
    grid = SparseGrid(width=size[0], height=size[1], edge=edge, layer=layer)
    places = traced_places(grid)
    assert (places < np.array(size)).all()
    block = places // edge
    number = block[:, 1] * grid.column_count + block[:, 0]
    np.testing.assert_array_equal(number, np.arange(grid.block_count))


@pytest.mark.parametrize("edge", EDGES.values())
def test_every_row_and_column_of_a_tile_has_one_and_neighbours_keep_apart(edge: int) -> None:
    tile = edge * edge
    grid = SparseGrid(width=tile, height=tile, edge=edge)
    places = traced_places(grid)
    for axis in (0, 1):
        np.testing.assert_array_equal(np.sort(places[:, axis]), np.arange(tile))
    # The same over the border to the next tile.
    shifts = np.array([(x, y) for x in (-tile, 0, tile) for y in (-tile, 0, tile)])
    around = (places[None] + shifts[:, None]).reshape(-1, 2)
    distance = np.linalg.norm(around[:, None] - places[None], axis=-1)
    assert distance[distance > 0.0].min() == pytest.approx(LEAST_DISTANCE[edge])


@pytest.mark.parametrize("edge", EDGES.values())
def test_as_many_rays_as_a_block_has_pixels_trace_each_once(edge: int) -> None:
    width, height = 4 * edge * edge, 3 * edge * edge
    counts = np.zeros(width * height, dtype=int)
    for layer in range(edge * edge):
        grid = SparseGrid(width=width, height=height, edge=edge, layer=layer)
        counts += np.bincount(np.array(select_sparse_pixels(grid)), minlength=width * height)
    assert (counts == 1).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sparsity": 5}, "sparsity must be one of"),
        ({"max_normal_angle": 0.0}, "max_normal_angle"),
        ({"max_plane_slope": 0.0}, "max_plane_slope"),
        ({"max_depth_ratio": -1.0}, "max_depth_ratio"),
        ({"min_support": 1.5}, "min_support"),
    ],
)
def test_impossible_settings_are_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ReconstructionConfig(**changes)  # type: ignore[arg-type]
