"""Which pixels trace diffuse cones: one of each block of n x n, in a rotated grid.

The traced pixel of the block (bx, by) is the one at (by mod n, -bx mod n) in it. From block to
block the pattern steps by (n, -1) and (1, n): a square grid turned by atan(1 / n), which wraps
within each block, so that every row and every column of n x n blocks has exactly one traced pixel
and no two of them touch by a side. Of all such patterns it keeps the traced pixels farthest apart:
at least sqrt 2, sqrt 5 and sqrt 10 pixels for n = 2, 3 and 4. Where a pixel has several camera
rays, the pattern of each shifts by one more pixel, so that n^2 of them trace every pixel once.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi


@dataclass(frozen=True, kw_only=True)
class SparseGrid:
    """The blocks of a picture.

    Attributes
    ----------
    width, height
        Picture, pixels.
    edge
        Edge of a block, pixels; blocks at the right and lower rim may be cut.
    layer
        Number of the camera ray in its pixel, which shifts the pattern.
    """

    width: int
    height: int
    edge: int
    layer: int = 0

    @property
    def column_count(self) -> int:
        """Blocks in a row."""
        return -(-self.width // self.edge)

    @property
    def row_count(self) -> int:
        """Blocks in a column."""
        return -(-self.height // self.edge)

    @property
    def block_count(self) -> int:
        """Blocks, and so traced pixels."""
        return self.column_count * self.row_count


def select_sparse_pixels(grid: SparseGrid) -> mi.UInt32:
    """Return the traced pixel `y * width + x` of each block, blocks in rows.

    Where the rim of the picture cuts a block, the nearest pixel within it takes the place of one
    that is cut away.

    References
    ----------
    [Panteleev2014], slide "Sparse diffuse cone tracing".
    """
    block = dr.arange(mi.UInt32, grid.block_count)
    bx, by = block % grid.column_count, block // grid.column_count
    edge = grid.edge
    shift_x = dr.opaque(mi.UInt32, grid.layer % edge)
    shift_y = dr.opaque(mi.UInt32, (grid.layer + grid.layer // edge) % edge)
    x = edge * bx + (by + shift_x) % edge
    y = edge * by + (edge - bx % edge + shift_y) % edge
    return dr.minimum(y, grid.height - 1) * grid.width + dr.minimum(x, grid.width - 1)
