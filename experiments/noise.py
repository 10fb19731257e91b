"""Whether the reference of a run is quiet enough for what the run finds out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from metrics import Measurement
from reference.noise import LEAST_BATCHES, LEAST_FACTOR, noise_of
from reports.record import NoiseFloor

DIFFERENCE = "relmse_e2"
"""The metric that is of the same kind as the noise: it is the difference that is asked about."""


def noise_floors(
    batches: Mapping[str, np.ndarray], samples_per_pixel: int
) -> dict[str, NoiseFloor]:
    """Return how noisy the mean of each component is; none where it is dark or batches are few.

    Parameters
    ----------
    batches
        ``[batch, y, x, rgb]`` by component.
    samples_per_pixel
        Paths that they took together.
    """
    found = {}
    for name, each in batches.items():
        if len(each) >= LEAST_BATCHES:
            floor = noise_of(each, samples_per_pixel)
            if np.isfinite(floor.value):
                found[name] = NoiseFloor(value=floor.value, upper=floor.upper)
    return found


def noise_warnings(
    floors: Mapping[str, NoiseFloor], measured: Sequence[Measurement], samples_per_pixel: int
) -> list[str]:
    """Say in one line which components differ by less than ten times the noise of the reference.

    The smallest difference that a record asks about is the one that it finds.
    """
    noisy, wanted = [], 0.0
    for each in measured:
        floor = floors.get(each.component)
        if each.name != DIFFERENCE or floor is None:
            continue
        if floor.upper * LEAST_FACTOR > each.value:
            found = f"{each.value:.2g}" if each.value > floor.upper else "below it"
            noisy.append(f"{each.component} (noise relMSE {floor.upper:.2g}, difference {found})")
            # Below the noise nobody knows how far below.
            share = LEAST_FACTOR * floor.upper / max(each.value, floor.upper)
            wanted = max(wanted, samples_per_pixel * share)
    if not noisy:
        return []
    paths = 2 ** int(np.ceil(np.log2(wanted)))
    return [
        f"the reference is too noisy for {', '.join(noisy)}: its noise is not "
        f"{LEAST_FACTOR:g} times below the difference; render it with at least --spp {paths}"
    ]
