"""Places of a scene in the lattice of the voxels, and statistics over them.

Windows are snapped to their lattice, so what moves is the scene. A number of one phase says little:
two configurations closer than the spread over phases cannot be told apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from experiments.studies.check import INTERVAL_LEVEL, Measured

ROOT = 1.22074408460575947536
"""Root of x^4 = x + 1, the base of the three-dimensional Kronecker sequence [Roberts2018]."""


def phase_offsets(count: int) -> list[np.ndarray]:
    """Return `count` evenly spread offsets [3] in voxels, in (-0.5, 0.5), the same every time.

    References
    ----------
    [Roberts2018] M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.
    """
    steps = np.array([ROOT**-1, ROOT**-2, ROOT**-3])
    return [(0.5 + number * steps) % 1.0 - 0.5 for number in range(1, count + 1)]


def spread_of(values: Sequence[float]) -> Measured:
    """Return the standard deviation of normal values, with its chi-squared interval.

    Raises
    ------
    ValueError
        There are fewer than two.
    """
    degrees = len(values) - 1
    if degrees < 1:
        raise ValueError("spread_of: fewer than two values have no spread.")
    spread = float(np.std(values, ddof=1))
    tail = 0.5 * (1.0 - INTERVAL_LEVEL)
    low, high = (
        spread * math.sqrt(degrees / float(chdtri(degrees, share))) for share in (tail, 1.0 - tail)
    )
    return Measured(value=spread, low=low, high=high)
