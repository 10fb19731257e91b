"""Curves and maps of a sweep over sub-voxel places, and what the study's numbers are."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from experiments.studies.figures import FigureShelf
from metrics.aliasing import (
    DIFFERENCE_FORMULA,
    DIFFERENCE_RMS_FORMULA,
    POP_FORMULA,
    POWER_RIPPLE_FORMULA,
)
from metrics.energy import energy_ratio
from metrics.luminance import luminance
from metrics.voxel_period import PERIOD_RMS_FORMULA, PERIOD_SHARE_FORMULA
from reports.study_figures import Bounded, CurveFigure, Definition, Series

SCALE_QUANTILE, LEAST_SCALE = 0.97, 1e-4
"""The colour scale of changes reaches to this quantile of them, but no less than what is rounding,
over the mean light."""

MOST_RECEIVERS = 48
"""Columns of a map; more are left out."""

METRICS = "metrics/aliasing.py"

DEFINITIONS = (
    Definition(
        name="power ripple (I1)", formula=POWER_RIPPLE_FORMULA, source=f"{METRICS}, power_ripple"
    ),
    Definition(
        name="temporal difference error (I2)",
        formula=DIFFERENCE_FORMULA,
        source=f"{METRICS}, temporal_difference_error; intervals over batches of the reference",
    ),
    Definition(
        name="temporal difference, RMS (I2)",
        formula=DIFFERENCE_RMS_FORMULA,
        source=f"{METRICS}, temporal_difference_rms; the reference's noise is taken out",
    ),
    Definition(name="pops (I3)", formula=POP_FORMULA, source=f"{METRICS}, pop_share"),
    Definition(
        name="voxel period, RMS",
        formula=PERIOD_RMS_FORMULA,
        source="metrics/voxel_period.py, voxel_period_rms",
    ),
    Definition(
        name="voxel period, share of energy",
        formula=PERIOD_SHARE_FORMULA,
        source="metrics/voxel_period.py, voxel_period_share",
    ),
    Definition(
        name="lit cube, energy and ledger",
        formula="mean light of all receivers over path-traced light; in the ledger, with some "
        "causes replaced by what is exact",
        source="experiments/studies/aliasing/turned_cube.py; intervals over places in the lattice",
    ),
    Definition(
        name="moved by whole voxels, largest difference (I5)",
        formula="largest |after - before| / mean before, of scene, viewer and windows together",
        source=f"{METRICS}, recentring_difference",
    ),
)


def add_sweep_figures(
    shelf: FigureShelf,
    group: str,
    places: np.ndarray,
    powers: Mapping[str, np.ndarray],
    light: Mapping[str, np.ndarray],
    batches: np.ndarray,
) -> None:
    """Keep power and error over places, and maps of the changes of light.

    Parameters
    ----------
    shelf, group
        Where they go.
    places, powers, light, batches
        As `experiments.studies.aliasing.moved_rooms.MovedRoom` has them.
    """
    truth = batches.mean(axis=0)
    errors = {
        how: [_ratio(frame, batches[:, number]) for number, frame in enumerate(found)]
        for how, found in light.items()
    }
    exact = {how: [Bounded(value=float(each)) for each in line] for how, line in powers.items()}
    curves = {
        "Power in the voxels": ("power over what should be there", exact, "The truth is 1 (I1)."),
        "Light of the receivers": (
            "light over path-traced light",
            errors,
            "Mean over all receivers, with 95 % intervals; a smooth method is a flat line.",
        ),
    }
    for title, (label, lines, caption) in curves.items():
        shelf.add(
            CurveFigure(
                group=group,
                title=title,
                caption=caption,
                x_label="place, voxels of the level",
                y_label=label,
                series=[
                    Series(
                        name=how,
                        x=[float(place) for place in places],
                        values=line,
                    )
                    for how, line in lines.items()
                ],
            )
        )
    true_change = np.diff(luminance(truth), axis=0)
    mean = float(luminance(truth).mean())
    beyond = {
        how: (np.diff(luminance(found), axis=0) - true_change) / mean
        for how, found in light.items()
    }
    # One scale for all ways to inject.
    sizes = np.abs(np.stack(list(beyond.values())))
    scale = max(float(np.quantile(sizes, SCALE_QUANTILE)), LEAST_SCALE)
    for how, values in beyond.items():
        shelf.add_map(
            group,
            f"Changes beyond the truth's, {how}",
            values[:, :MOST_RECEIVERS],
            low=-scale,
            high=scale,
            unit="of the mean light",
            caption="A column for each receiver, a row for each step (I2); a pop is a spot (I3).",
        )


def _ratio(frame: np.ndarray, batches: np.ndarray) -> Bounded:
    """Return light [point, rgb] over that of a reference [batch, point, rgb]."""
    found = energy_ratio(frame[:, None], batches[:, :, None])
    return Bounded(value=found.value, low=found.low, high=found.high)
