"""Synthetic references: a known true image and independent noisy batches of it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray


@pytest.fixture(scope="session")
def truth() -> NDArray[np.float64]:
    """Build a 16 x 16 image of coloured blocks, one of them dark: the true reference."""
    generator = np.random.default_rng(1)
    blocks = np.exp(0.8 * generator.normal(size=(4, 4, 3)))
    blocks[0, 0] = 0.01
    return blocks.repeat(4, axis=0).repeat(4, axis=1)
