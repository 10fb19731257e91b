"""Maps of banding: where a glossy picture changes with the start phase of its marches."""

from __future__ import annotations

import numpy as np

from experiments.studies.figures import FigureShelf

HIGH = 0.1
"""End of the colour scale, over the mean light of what is glossy."""


def add_spread_map(
    shelf: FigureShelf, group: str, title: str, pictures: np.ndarray, mask: np.ndarray
) -> None:
    """Keep the spread over start phases of luminance [phase, row, column], where it counts."""
    spread = pictures.std(axis=0, ddof=1) / float(pictures[:, mask].mean())
    shelf.add_map(
        group,
        title,
        np.where(mask, spread, 0.0),
        high=HIGH,
        unit="of the mean light",
        caption="Standard deviation over start phases (B1); black where nothing is judged.",
    )
