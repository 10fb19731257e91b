"""All image metrics of one component, in one call."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from metrics.colour_difference import delta_e_2000, delta_e_itp
from metrics.display import DisplaySettings
from metrics.energy import energy_ratio
from metrics.finite import check_finite
from metrics.images import Batches, Image, checked_inputs
from metrics.leaking import one_sided_excess
from metrics.luminance import luminance
from metrics.measurement import Measurement
from metrics.perceptual import mean_flip
from metrics.squared_error import (
    LEAST_RELATIVE_BATCHES,
    mean_relative_error,
    mse,
    relmse_e001,
    relmse_e2,
)
from metrics.structural import ssim_pq


def measure(
    test: ArrayLike, batches: ArrayLike, *, component: str, display: DisplaySettings
) -> list[Measurement]:
    """Every image metric of one component against its reference.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``, at least 11 x 11 pixels.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 4.
    component
        Name of what is compared, for the record.
    display
        How the scene is shown, from the reference of its whole image.

    Returns
    -------
    list[Measurement]
        Relative metrics first. Where a batch is black, as all are for a component that the scene
        does not have, relative metrics have no value: only absolute ones are returned, each with
        a note that says so.

    Raises
    ------
    ValueError
        For illegal input: NaN and infinity first.
    """
    checked_test, checked = checked_inputs(test, batches, least=LEAST_RELATIVE_BATCHES)
    notes = _negative_notes(checked_test, checked)
    black_count = int((luminance(checked).mean(axis=(1, 2)) <= 0).sum())
    measurements: list[Measurement] = []
    if black_count == 0:
        measurements += _relative(checked_test, checked, component)
    else:
        notes.append(
            f"{black_count} of {len(checked)} reference batches are black: "
            "relative metrics have no value and are left out"
        )
    measurements += _absolute(checked_test, checked, component, display)
    return [_with_notes(measurement, notes) for measurement in measurements]


def _relative(test: Image, batches: Batches, component: str) -> list[Measurement]:
    return [
        energy_ratio(test, batches, component=component),
        relmse_e2(test, batches, component=component),
        relmse_e001(test, batches, component=component),
        mean_relative_error(test, batches, component=component),
        *one_sided_excess(test, batches, component=component).values(),
    ]


def _absolute(
    test: Image, batches: Batches, component: str, display: DisplaySettings
) -> list[Measurement]:
    nits = display.nits_per_unit
    return [
        mse(test, batches, component=component),
        mean_flip(test, batches, display.flip, component=component),
        ssim_pq(test, batches, nits_per_unit=nits, component=component),
        delta_e_itp(test, batches, nits_per_unit=nits, component=component),
        delta_e_2000(test, batches, exposure=display.exposure, component=component),
    ]


def _negative_notes(test: Image, batches: Batches) -> list[str]:
    counts = {
        "test": check_finite(test, "test").negative_count,
        "reference": check_finite(np.asarray(batches.mean(axis=0)), "reference").negative_count,
    }
    return [
        f"{count} negative values in the {name}, which a display shows as black"
        for name, count in counts.items()
        if count
    ]


def _with_notes(measurement: Measurement, notes: list[str]) -> Measurement:
    return replace(measurement, note="; ".join(filter(None, [measurement.note, *notes])))
