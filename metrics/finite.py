"""The first metric: whether every value of an image is a number.

FLIP hides a NaN and a mean spreads it, so finiteness is checked before anything else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class FiniteCheck:
    """How many values of an image are no legal radiance."""

    name: str
    """What was checked, as it appears in messages."""
    nan_count: int
    """Values that are NaN."""
    infinite_count: int
    """Values that are plus or minus infinity."""
    negative_count: int
    """Values below zero, minus infinity included."""
    first_bad_index: tuple[int, ...] | None
    """Array index of the first NaN or infinite value, ``(row, column, channel)`` for an image."""

    @property
    def is_finite(self) -> bool:
        """True where neither NaN nor infinity was found; negative values are finite."""
        return self.nan_count == 0 and self.infinite_count == 0


def check_finite(image: NDArray[Any], name: str) -> FiniteCheck:
    """Count NaN, infinite and negative values.

    Parameters
    ----------
    image
        Array of real numbers of any shape.
    name
        What it is, for messages.

    Returns
    -------
    FiniteCheck
        The counts, and the index of the first NaN or infinity.
    """
    bad = ~np.isfinite(image)
    first = tuple(int(i) for i in np.argwhere(bad)[0]) if bad.any() else None
    return FiniteCheck(
        name=name,
        nan_count=int(np.isnan(image).sum()),
        infinite_count=int(np.isinf(image).sum()),
        negative_count=int((image < 0).sum()),
        first_bad_index=first,
    )


def require_finite(image: NDArray[Any], name: str) -> FiniteCheck:
    """Refuse an image that holds NaN or infinity.

    Parameters
    ----------
    image
        Array of real numbers of any shape.
    name
        What it is, for messages.

    Returns
    -------
    FiniteCheck
        The counts of an image that passed; its ``negative_count`` may be above 0.

    Raises
    ------
    ValueError
        With the counts and the first pixel, when a value is NaN or infinite.
    """
    check = check_finite(image, name)
    if not check.is_finite:
        raise ValueError(
            f"{name} must be finite, got {check.nan_count} NaN and {check.infinite_count} "
            f"infinite values of {image.size}, the first at index {check.first_bad_index}: "
            "mend the renderer that made it, a metric of it would mean nothing."
        )
    return check
