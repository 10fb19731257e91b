"""How evenly points fill the unit cube."""

from __future__ import annotations

import numpy as np

COUNT = 1 << 20
"""Points that are looked at."""


def deviation(columns: list[np.ndarray], bins: int) -> float:
    """How far the counts of a grid of cells lie from even ones, in standard deviations."""
    cell = np.zeros(COUNT, int)
    for column in columns:
        cell = cell * bins + (column * bins).astype(int)
    cells = bins ** len(columns)
    counts = np.bincount(cell, minlength=cells)
    chi_squared = float(np.sum((counts - COUNT / cells) ** 2) / (COUNT / cells))
    return float((chi_squared - (cells - 1)) / np.sqrt(2.0 * (cells - 1)))
