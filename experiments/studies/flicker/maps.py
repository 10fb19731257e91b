"""Maps of flicker: where in the picture the light of surfaces does not hold still."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from experiments.studies.figures import FigureShelf
from metrics.flicker import Motion, changes
from metrics.luminance import luminance

HIGH = 0.25
"""End of the colour scale, over the mean light."""


def add_flicker_maps(
    shelf: FigureShelf,
    group: str,
    frames: Mapping[tuple[int, bool], np.ndarray],
    batches: np.ndarray,
    motion: Motion,
) -> None:
    """Keep the true picture and, for each sparsity with and without history, a map of changes.

    Parameters
    ----------
    shelf, group
        Where they go.
    frames, batches, motion
        As `experiments.studies.flicker.sequences.Sequence` has them.
    """
    truth = batches.mean(axis=0)
    shelf.add_picture(group, "Path tracing", truth[0], caption="Indirect light, first frame.")
    mean = float(luminance(truth).mean())
    true_changes = _change_maps(truth, motion)
    for (sparsity, has_history), found in sorted(frames.items()):
        beyond = luminance(_change_maps(found, motion) - true_changes)
        followed = motion.is_followed.sum(axis=0)
        rms = np.sqrt((beyond**2).sum(axis=0) / np.maximum(followed, 1)) / mean
        shelf.add_map(
            group,
            f"N = {sparsity}, " + ("accumulated" if has_history else "single frames"),
            rms,
            high=HIGH,
            unit="of the mean light",
            caption="RMS over frames of the change beyond the truth's, with the truth's noise; "
            "black where a pixel cannot be followed.",
        )


def _change_maps(frames: np.ndarray, motion: Motion) -> np.ndarray:
    """Return changes [step, row, column, rgb]; 0 where a pixel cannot be followed."""
    found = np.zeros((*motion.is_followed.shape, 3))
    found[motion.is_followed] = changes(frames, motion)
    return found
